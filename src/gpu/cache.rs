//! Cache of shared objects by weak references.

use std::any::Any;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Weak references by key. Values have any type, so that the device's pipeline cache does not depend on `Pipeline`.
pub(super) struct WeakCache<K>(Mutex<HashMap<K, Weak<dyn Any + Send + Sync>>>);

impl<K> Default for WeakCache<K> {
    fn default() -> Self {
        WeakCache(Mutex::default())
    }
}

impl<K: Eq + Hash> WeakCache<K> {
    /// Value of a key, if it is still alive and of type `V`.
    pub(super) fn find<V: Any + Send + Sync>(&self, key: &K) -> Option<Arc<V>> {
        let values = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let value = values.get(key).and_then(Weak::upgrade)?;
        value.downcast().ok()
    }

    /// Inserts a value and removes the entries of dropped values.
    pub(super) fn insert<V: Any + Send + Sync>(&self, key: K, value: Arc<V>) {
        let value: Arc<dyn Any + Send + Sync> = value;
        let mut values = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        values.retain(|_, value| value.strong_count() > 0);
        values.insert(key, Arc::downgrade(&value));
    }
}
