//! Regression tests of known failures of splatting methods, by entry of the project's catalogue: `f024_…` is the right
//! behaviour at its entry 24, `m07_…` its metamorphic relation M7, `b01_…` the accuracy gained by this engine's
//! numerics over the usual ones. An entry that does not apply to this engine has a line `* 22: why` at the head of the
//! module of its section. Tolerances are derived where they stand; U = 2⁻²⁴ throughout.
//!
//! Every measured error is printed as a row of a table, beside its bound:
//!
//!     cargo test --test device stability:: -- --nocapture | grep '^|' | sort

mod adam;
mod bounds;
mod camera;
mod compositing;
mod conic;
mod covariance;
mod coverage;
mod depth;
mod device;
mod extremes;
#[allow(dead_code, reason = "shared with tests/host/io, which uses all of it")]
mod files;
mod floaters;
mod growth;
mod lab;
mod lists;
mod loss;
mod mcmc;
mod mip;
mod numerics;
mod numerics_more;
mod numerics_order;
mod optimiser;
mod projection;
mod props;
mod rasterize_inria;
mod relations;
mod relations_light;
mod relations_step;
mod sorting;
mod trained;
