//! Written by `build.rs`: a module per kernel in `glsl/`, and the table of all variants.

#![allow(
    rustdoc::broken_intra_doc_links,
    rustdoc::invalid_html_tags,
    reason = "the comments come from GLSL, where `range[tile]` is no link and `a<b` no tag"
)]

/// The words of a SPIR-V module from its bytes, which `include_bytes!` does not align.
const fn words<const COUNT: usize>(bytes: &[u8]) -> [u32; COUNT] {
    assert!(bytes.len() == 4 * COUNT);
    let mut words = [0; COUNT];
    let mut i = 0;
    while i < COUNT {
        let b = 4 * i;
        words[i] = u32::from_le_bytes([bytes[b], bytes[b + 1], bytes[b + 2], bytes[b + 3]]);
        i += 1;
    }
    words
}

include!(concat!(env!("OUT_DIR"), "/kernels.rs"));
