# The two commands are `make demo` and `make test`; both first install what is missing.

# Features of all tests: one build serves them.
TESTED = --features capi,window
PREFIX ?= /usr/local
# Modules with half of the time of the device's tests.
HALF = simplify:: stability:: faults::
# Unit tests: without optimisation, which would take longer than it saves. Other tests share an optimised library.
UNIT = cargo test $(TESTED) --lib --config profile.dev.package.ashfall.opt-level=0

.PHONY: demo check test lints capi package examples needs bench bench-native soak fuzz clients limits setup

# Trains the built-in scene, renders its test views and says which pictures to look at.
demo: setup
	cargo run --release -- demo

# For every change, in minutes: format, lints, the engine by itself, tests without a device, kernels and frames.
check: setup lints
	$(UNIT)
	cargo test $(TESTED) --test host
	cargo test $(TESTED) --test device -- kernels:: frame::

# For every merge: all tests, those of documentation, and frames on a lesser device. Tests of the device take turns in
# their process; two processes with half of them each keep two cores busy. Unit tests, a build of their own, follow one
# half, frames on a lesser device the other.
test: setup lints
	cargo test $(TESTED) --no-run --test '*'
	cargo build $(TESTED) --examples
	$(MAKE) examples
	{ cargo test $(TESTED) --test device -- $(HALF) && $(UNIT); } >target/tests-1.log 2>&1 & first=$$!; \
	{ cargo test $(TESTED) --test device -- $(HALF:%=--skip %) && $(LESSER_FRAMES); } >target/tests-2.log 2>&1 & second=$$!; \
	cargo test $(TESTED) --test host --test binary --test slow; failed=$$?; \
	wait $$first || failed=1; wait $$second || failed=1; \
	cat target/tests-1.log target/tests-2.log; exit $$failed
	cargo test $(TESTED) --doc

# The programs of `examples`, run; pictures go to out/examples.
examples: setup
	mkdir -p out/examples
	cargo run $(TESTED) --example embed
	cargo run $(TESTED) --example train_builtin out/examples/trained.png 100
	cargo run $(TESTED) --example render_ply out/examples/trained.ply out/examples/rendered.png

# The renderer, and the engine without its tools, are builds of their own: hosts that embed it have those.
lints:
	cargo fmt --check
	cargo clippy $(TESTED) --all-targets -- -D warnings
	cargo clippy --lib --no-default-features --features compile,capi -- -D warnings
	cargo clippy --lib --no-default-features --features compile,train -- -D warnings

# The C libraries with header, pkg-config and CMake packages: make capi PREFIX=/usr/local; DESTDIR for packages.
capi: setup
	scripts/capi "$(PREFIX)"

# The package for crates.io, with compiled shaders: target/package/ashfall-VERSION.crate.
package: setup
	scripts/package

# What scenes need, against the fixed recipe and MCMC: out/needs/needs.html. Hours on a software device; goes on where it
# was broken off. NEEDS="photos/ --seeds 1" says more.
needs: setup
	cargo run --release -- needs $(NEEDS)

bench: setup
	cargo bench

# The baselines, with the renderer on the processor built for the processor at hand. A target of its own, so that
# other builds stay as they are.
bench-native: setup
	RUSTFLAGS="-C target-cpu=native" CARGO_TARGET_DIR=target/native \
		cargo run --release -- bench kernels --filter baseline

setup:
	@scripts/setup

# Candidate devices: in all, 64 MiB to a binding (the tests' largest picture takes half of that), 1 GiB of memory,
# workgroups of 64 and no subgroup operations; for tests of small pictures, 4 MiB to a binding.
LESSER = binding=67108864,memory=1073741824,workgroup=64,subgroups=off
LESSER_PICTURES = binding=4194304,memory=268435456,workgroup=64,subgroups=off
LESSER_FRAMES = ASHFALL_TEST_LIMITS=$(LESSER_PICTURES) cargo test $(TESTED) --test device -- frame:: large::

# A second software device, of Debian's package chromium-common: subgroups of 4, and functions no more exact than Vulkan
# demands.
SWIFTSHADER = /usr/lib/chromium/vk_swiftshader_icd.json

# The suite on lesser devices, and kernels and frames with lavapipe's other subgroups, of 4 and 16 (Mesa's cache of
# shaders ignores the width), and on SwiftShader. Tests of the binary take the device as it is: only tests read these
# limits.
limits: setup
	ASHFALL_TEST_LIMITS=$(LESSER) cargo test $(TESTED) --test device
	ASHFALL_TEST_LIMITS=$(LESSER_PICTURES) cargo test $(TESTED) --test device -- frame:: large:: kernels:: gradients::
	for bits in 128 512; do \
		MESA_SHADER_CACHE_DISABLE=true LP_NATIVE_VECTOR_WIDTH=$$bits \
			cargo test $(TESTED) --test device -- frame:: kernels:: || exit 1; \
	done
	@if [ -e $(SWIFTSHADER) ]; then \
		VK_DRIVER_FILES=$(SWIFTSHADER) cargo test $(TESTED) --test device -- frame:: kernels::; \
	else echo "left out: SwiftShader; apt-get install chromium-common"; fi

# Every failure at every moment, a hundred kills, and a long run: about an hour on two cores. Prints its counts.
soak: setup
	cargo test --test device -- faults:: --ignored --skip disks:: --nocapture --test-threads 1
	cargo test --test device -- --ignored large_

# Ten million executions of every fuzz target under libFuzzer; `scripts/fuzz` takes other numbers.
fuzz: setup
	scripts/fuzz

# Files of every format through independent programs, which npm and pip install under target/clients.
clients: setup
	npm install --no-save --prefix target/clients @playcanvas/splat-transform@3.7.0
	python3 -m venv target/clients/venv
	target/clients/venv/bin/pip install --quiet "gsply[spz,sogs]==0.4.6"
	SPLAT_TRANSFORM=$(CURDIR)/target/clients/node_modules/.bin/splat-transform \
		GSPLY_PYTHON=$(CURDIR)/target/clients/venv/bin/python \
		cargo test --test slow -- clients --ignored
