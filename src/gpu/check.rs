//! Conversion of Vulkan results to errors.

use crate::{Error, Result};

/// Turns an error of a Vulkan call into [`Error::Vulkan`] with the name of the call.
pub(super) fn check<T>(call: &'static str, result: ash::prelude::VkResult<T>) -> Result<T> {
    result.map_err(|code| Error::Vulkan {
        call,
        result: format!("{code:?}"),
    })
}
