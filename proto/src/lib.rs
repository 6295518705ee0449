//! The wire's types: socket messages and the pose packet.
