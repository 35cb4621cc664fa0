//! Exceptions to the rule that shader, host, reference and test cases have one name.

/// Files of the paired folders without a kernel, and missing partners of kernels, with the reason.
pub(crate) const UNPAIRED: &[(&str, &str)] = &[
    ("src/kernels/choices.rs", "what is chosen of all of them, and why"),
    ("src/kernels/generated.rs", "what follows from all shaders at once"),
    ("src/reference/real.rs", "the numbers that formulas are written over"),
    ("src/reference/dual.rs", "numbers that carry derivatives"),
    (
        "src/reference/running_error.rs",
        "numbers that carry what they are sums of",
    ),
    ("src/reference/linear.rs", "vectors and matrices of such numbers"),
    (
        "src/reference/sh.rs",
        "part of project: one basis for its forward and backward",
    ),
    (
        "src/reference/smoothing.rs",
        "part of project: what the 3D filter makes of a splat before",
    ),
    (
        "src/reference/plane.rs",
        "part of project and of rasterize: a splat's plane, and the surface of a pixel",
    ),
    (
        "src/reference/adam_color.rs",
        "part of adam: the gradient is a basis function times a colour's",
    ),
    (
        "src/reference/surfel.rs",
        "part of project and of rasterize: a surfel, and the hit of a ray",
    ),
    (
        "src/reference/surfel_backward.rs",
        "the operations composed: the gradient of a picture by surfels",
    ),
    ("src/reference/dropout.rs", "part of project: random splats left out"),
    ("src/reference/ssim.rs", "part of loss: the similarity of one channel"),
    (
        "src/reference/primitive.rs",
        "part of rasterize and of project: a splat at a pixel, and its extent",
    ),
    (
        "src/reference/tiles.rs",
        "part of project: which tiles an ellipse meets",
    ),
    ("src/reference/frame.rs", "the operations composed: a picture"),
    (
        "src/reference/bound/stack.rs",
        "part of the bounds: what a pixel sees when nothing is saved",
    ),
    (
        "src/reference/bound/picture.rs",
        "what frames that save work may lose: judges the accuracy that rendering is given",
    ),
    ("src/reference/bound/gradient.rs", "what their gradients may lose"),
    (
        "src/reference/sample.rs",
        "some pixels of a picture, and what rounding may change of each",
    ),
    ("src/reference/ray.rs", "judges linear projection"),
    (
        "src/reference/gradient.rs",
        "the operations composed: a training step's gradient",
    ),
    (
        "src/reference/relocate.rs",
        "judges the host's relocation, which has no kernel",
    ),
    (
        "src/reference/baseline_16x16.rs",
        "a baseline: it composites what rasterize does",
    ),
    (
        "src/reference/baseline_16x16_backward.rs",
        "a baseline: it differentiates what rasterize does",
    ),
    ("src/reference/compact.rs", "a filter: the test states it"),
    ("src/reference/gather.rs", "one indexed load: the test states it"),
    ("src/reference/select_rows.rs", "indexed loads: the test states them"),
    ("src/reference/plan.rs", "a few divisions: the test states them"),
    (
        "tests/device/kernels/longest.rs",
        "several kernels, over the longest list that they are given",
    ),
    (
        "tests/device/kernels/rasterize_inria.rs",
        "judged by whole frames: tests/device/stability/rasterize_inria.rs",
    ),
    ("src/reference/present.rs", "a copy: the test states it"),
    ("src/reference/sum_by_splat.rs", "folds: the test states them"),
];
