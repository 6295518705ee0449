//! What a calibration sees, for people.
