//! The operations: one file each, of the same name as its shader in `glsl/`.
//!
//! [`generated`] holds what follows from the shaders alone: variants, tunables, parameters, bindings and
//! a wrapper per kernel. A file here adds what a host has to decide: which variant suits a device, how
//! many groups there are.
//!
//! **Invariant:** no `unsafe` and no `ash` here; barriers follow from the bindings' declared access.

pub mod generated;

pub use generated::KERNELS;
