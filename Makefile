# The two commands are `make demo` and `make test`; both first install what is missing.

.PHONY: demo test bench bench-native soak fuzz setup

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

# The yardsticks, with the renderer on the processor built for the processor at hand. A target of its own, so that
# other builds stay as they are.
bench-native: setup
	RUSTFLAGS="-C target-cpu=native" CARGO_TARGET_DIR=target/native \
		cargo run --release -- bench kernels --filter yardstick

setup:
	@scripts/setup

# Every failure at every moment, a hundred kills, and a long run: about an hour on two cores. Prints its counts.
soak: setup
	cargo test --test faults -- --ignored --skip disks:: --nocapture --test-threads 1
	cargo test --test kernels -- --ignored large_

# Ten million executions of every fuzz target under libFuzzer; `scripts/fuzz` takes other numbers.
fuzz: setup
	scripts/fuzz
