//! The configuration's types, its commented default and its errors.
