//! One file of Rust as syntax: its modules, what they define, import and mention, and what of it is a test.

pub mod attributes;
pub mod code_file;
pub mod collector;
pub mod imports;
pub mod parts;
pub mod token_paths;
