//! Live objects of the C interface. A handle is a number of this registry in the guise of a pointer: numbers are not
//! used twice, so that a destroyed handle is known for one.

use super::failure::Failure;
use super::session::RendererSession;
use crate::gpu::Gpu;
use crate::render::Model;
use crate::scene::Splats;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// The library on a host's device.
#[derive(Debug)]
pub struct AshfallDevice {
    _private: (),
}

/// Splats in the host's memory.
#[derive(Debug)]
pub struct AshfallScene {
    _private: (),
}

/// Splats on the device.
#[derive(Debug)]
pub struct AshfallModel {
    _private: (),
}

/// A renderer: kernels and the working buffers of its frames.
#[derive(Debug)]
pub struct AshfallRenderer {
    _private: (),
}

/// An object behind a handle.
#[derive(Debug)]
pub(super) enum LiveObject {
    Device(Gpu),
    Scene(Arc<Splats>),
    Model(Arc<Model>),
    Renderer(Arc<Mutex<RendererSession>>),
}

impl LiveObject {
    fn kind(&self) -> &'static str {
        match self {
            LiveObject::Device(_) => "device",
            LiveObject::Scene(_) => "scene",
            LiveObject::Model(_) => "model",
            LiveObject::Renderer(_) => "renderer",
        }
    }
}

/// A type of handles: its name, and the value of an object of its kind.
pub(super) trait Handle {
    type Value;
    const KIND: &'static str;
    fn of(object: &LiveObject) -> Option<Self::Value>;
}

macro_rules! handles {
    ($($handle:ident, $variant:ident, $kind:literal, $value:ty;)*) => {
        $(impl Handle for $handle {
            type Value = $value;
            const KIND: &'static str = $kind;
            fn of(object: &LiveObject) -> Option<$value> {
                match object {
                    LiveObject::$variant(value) => Some(value.clone()),
                    _ => None,
                }
            }
        })*
    };
}

handles! {
    AshfallDevice, Device, "device", Gpu;
    AshfallScene, Scene, "scene", Arc<Splats>;
    AshfallModel, Model, "model", Arc<Model>;
    AshfallRenderer, Renderer, "renderer", Arc<Mutex<RendererSession>>;
}

#[derive(Debug)]
struct Registry {
    last: usize,
    live: BTreeMap<usize, LiveObject>,
}

static OBJECTS: Mutex<Registry> = Mutex::new(Registry {
    last: 0,
    live: BTreeMap::new(),
});

fn with<T>(run: impl FnOnce(&mut Registry) -> T) -> T {
    run(&mut OBJECTS.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Registers an object.
pub(super) fn insert<H: Handle>(object: LiveObject) -> *mut H {
    with(|objects| {
        // Distances of 16 keep handles apart from small numbers mistaken for pointers.
        objects.last += 16;
        objects.live.insert(objects.last, object);
        std::ptr::without_provenance_mut(objects.last)
    })
}

/// The object of a handle.
pub(super) fn find<H: Handle>(handle: *mut H) -> Result<H::Value, Failure> {
    let kind = H::KIND;
    if handle.is_null() {
        return Err(Failure::argument(format!("{kind}: a null handle")));
    }
    with(|objects| match objects.live.get(&handle.addr()) {
        None => Err(Failure::argument(format!(
            "{kind}: a destroyed handle, or none of this library"
        ))),
        Some(object) => {
            H::of(object).ok_or_else(|| Failure::argument(format!("{kind}: the handle of a {}", object.kind())))
        }
    })
}

/// Removes an object; a null handle is no object.
pub(super) fn remove<H: Handle>(handle: *mut H) -> Result<(), Failure> {
    if handle.is_null() {
        return Ok(());
    }
    find(handle)?;
    // Dropped after the lock is released.
    drop(with(|objects| objects.live.remove(&handle.addr())));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn handles_are_refused_once_destroyed_and_of_other_kinds() {
        let scene: *mut AshfallScene = insert(LiveObject::Scene(Arc::default()));
        assert!(find(scene).is_ok());
        let message = |found: Result<(), Failure>| found.unwrap_err().message;
        let model = scene.cast::<AshfallModel>();
        assert_eq!(message(find(model).map(drop)), "model: the handle of a scene");
        assert_eq!(message(remove(model)), "model: the handle of a scene");
        remove(scene).unwrap();
        let gone = "scene: a destroyed handle, or none of this library";
        assert_eq!(message(find(scene).map(drop)), gone);
        assert_eq!(message(remove(scene)), gone);
        // The number is not used again.
        let other: *mut AshfallScene = insert(LiveObject::Scene(Arc::default()));
        assert_eq!(message(find(scene).map(drop)), gone);
        remove(other).unwrap();
        assert_eq!(
            message(find(std::ptr::null_mut::<AshfallScene>()).map(drop)),
            "scene: a null handle"
        );
        remove(std::ptr::null_mut::<AshfallScene>()).unwrap();
    }
}
