//! The program `lab`: see the library `farfield_lab`.

use std::process::ExitCode;

fn main() -> ExitCode {
    farfield_lab::main()
}
