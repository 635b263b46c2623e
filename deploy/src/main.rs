//! The program `farfield`: see its library.

use std::process::ExitCode;

fn main() -> ExitCode {
    farfield::main()
}
