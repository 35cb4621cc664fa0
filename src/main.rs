//! The `ashfall` binary: everything is in the library's `cli`.

fn main() -> std::process::ExitCode {
    ashfall::main()
}
