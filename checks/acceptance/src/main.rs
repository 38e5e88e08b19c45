//! The program `ecan-acceptance`: runs the programs of the SDK on an EtherCAT master and checks what
//! they do. `scripts/acceptance.sh` finds or builds the programs and starts it; docs/TESTING.md
//! describes it.
//!
//! ```text
//! ecan-acceptance --bin target/release --bin target/release/examples --library sim
//! ```
#![forbid(unsafe_code)]

mod arguments;
mod bench;
mod bus;
mod child;
mod kernel_log;
mod need;
mod record;
mod report;
mod runner;
mod slave;
mod step;
mod steps;
mod stop;
mod table;
mod variant_matrix;

use std::process::ExitCode;

use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::screen::parse_arguments;
use ecan_tool_support::print_error_line;

use arguments::Arguments;

fn main() -> ExitCode {
    let arguments: Arguments = parse_arguments();
    if arguments.list {
        runner::list(&arguments);
        return ExitCode::SUCCESS;
    }
    let outcome = Interrupt::install_with_message("stopping: the running programs are ended")
        .map_err(|error| error.to_string())
        .and_then(|interrupt| match arguments.each_variant {
            true => variant_matrix::run(&arguments, interrupt),
            false => runner::run(&arguments, interrupt),
        });
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            print_error_line!("ecan-acceptance: {error}");
            ExitCode::from(2)
        }
    }
}
