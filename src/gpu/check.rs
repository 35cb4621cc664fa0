//! Vulkan results as errors.

use crate::{Error, Result};

/// [`Error::Vulkan`] with the name of the call, where its result is an error.
pub(super) fn check<T>(call: &'static str, result: ash::prelude::VkResult<T>) -> Result<T> {
    result.map_err(|code| Error::Vulkan {
        call,
        result: format!("{code:?}"),
    })
}
