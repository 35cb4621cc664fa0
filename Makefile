# The two commands are `make demo` and `make test`; both first install what is missing.

.PHONY: demo test bench fuzz setup

# Trains the built-in scene, renders its test views and says which pictures to look at.
demo: setup
	cargo run --release -- demo

# Everything that is checked before a change is merged.
test: setup
	cargo fmt --check
	cargo clippy --all-targets -- -D warnings
	cargo test

bench: setup
	cargo bench

setup:
	@scripts/setup

# Ten million executions of every fuzz target under libFuzzer; `scripts/fuzz` takes other numbers.
fuzz: setup
	scripts/fuzz
