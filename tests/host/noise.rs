//! A fixed sequence of numbers.

/// Uniform numbers from −1 to 1.
pub(super) fn noise() -> impl FnMut() -> f32 {
    let mut state = 9u32;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    }
}
