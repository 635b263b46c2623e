//! The program `farfield`: see the library beside it.

use std::process::ExitCode;

fn main() -> ExitCode {
    farfield::main()
}
