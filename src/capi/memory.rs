//! Access to structures and arrays of C by their pointers.
//!
//! Structures begin with their size in the header that the caller was compiled with. Fields of later headers are zero,
//! which is their default; fields that this library does not know must be zero.

use super::failure::Failure;
use std::ffi::{CStr, c_char};

/// A structure of the C interface that begins with `uint32_t size`.
///
/// # Safety
/// `repr(C)`, begins with a `u32`, and all bits zero are a value.
pub(super) unsafe trait Sized32: Copy {
    /// Name in the header.
    const NAME: &'static str;
}

/// Declares the structures of a file.
macro_rules! sized {
    ($($name:ident),*) => {
        $(
            // SAFETY: `repr(C)`, begins with its size; fields are numbers, handles and pointers: zero is a value.
            unsafe impl $crate::capi::memory::Sized32 for $name {
                const NAME: &'static str = stringify!($name);
            }
        )*
    };
}
pub(super) use sized;

/// Reads a structure.
///
/// # Safety
/// Null, or valid for reads of as many bytes as its size field says.
pub(super) unsafe fn read<T: Sized32>(from: *const T) -> Result<T, Failure> {
    // SAFETY: as the caller says.
    unsafe { optional(from) }?.ok_or_else(|| Failure::argument(format!("{}: a null pointer", T::NAME)))
}

/// Reads a structure that may be absent.
///
/// # Safety
/// As [`read`].
pub(super) unsafe fn optional<T: Sized32>(from: *const T) -> Result<Option<T>, Failure> {
    if from.is_null() {
        return Ok(None);
    }
    // SAFETY: begins with its size.
    let size = unsafe { from.cast::<u32>().read_unaligned() } as usize;
    let mut value = std::mem::MaybeUninit::<T>::zeroed();
    let known = size_of::<T>();
    if size < 2 * size_of::<u32>() {
        let what = format!("{}: its size is {size}; set it to sizeof({})", T::NAME, T::NAME);
        return Err(Failure::argument(what));
    }
    for at in known..size {
        // SAFETY: within the structure's size.
        if unsafe { from.cast::<u8>().add(at).read() } != 0 {
            let what = format!("{}: fields beyond the {known} bytes of this library are set", T::NAME);
            return Err(Failure::argument(what));
        }
    }
    // SAFETY: both sides have as many bytes, and the destination is this function's own.
    unsafe { std::ptr::copy_nonoverlapping(from.cast::<u8>(), value.as_mut_ptr().cast(), size.min(known)) };
    // SAFETY: zeroed, and overwritten by the fields of the same type; zero is a value of all others.
    Ok(Some(unsafe { value.assume_init() }))
}

/// Reads an array of structures of one size.
///
/// # Safety
/// As [`read`], for each of `count` structures.
pub(super) unsafe fn array<T: Sized32>(from: *const T, count: u32) -> Result<Vec<T>, Failure> {
    if count == 0 {
        return Ok(Vec::new());
    }
    // SAFETY: as the caller says.
    let first = unsafe { read(from) }?;
    // SAFETY: begins with its size.
    let stride = unsafe { from.cast::<u32>().read_unaligned() };
    let mut all = Vec::with_capacity(count as usize);
    all.push(first);
    for index in 1..count as usize {
        // SAFETY: the array has `count` structures of this size.
        let next = unsafe { from.cast::<u8>().add(index * stride as usize) }.cast::<T>();
        // SAFETY: as the caller says.
        if unsafe { next.cast::<u32>().read_unaligned() } != stride {
            let what = format!("{} {index}: another size than that of the first", T::NAME);
            return Err(Failure::argument(what));
        }
        // SAFETY: as the caller says.
        all.push(unsafe { read(next) }?);
    }
    Ok(all)
}

/// Writes a structure, as much of it as the caller knows; its size field is kept.
///
/// # Safety
/// Null, or valid for reads and writes of as many bytes as its size field says.
pub(super) unsafe fn write<T: Sized32>(to: *mut T, value: &T) -> Result<(), Failure> {
    // SAFETY: as the caller says.
    unsafe { read(to.cast_const()) }?;
    // SAFETY: not null, and begins with its size.
    let size = unsafe { to.cast::<u32>().read_unaligned() } as usize;
    let (begin, end) = (size_of::<u32>(), size.min(size_of::<T>()));
    let source = std::ptr::from_ref(value).cast::<u8>();
    // SAFETY: within both structures, which do not overlap.
    unsafe { std::ptr::copy_nonoverlapping(source.add(begin), to.cast::<u8>().add(begin), end - begin) };
    Ok(())
}

/// Stores a value through a pointer of the caller's.
///
/// # Safety
/// Null, or valid for a write.
pub(super) unsafe fn store<T>(name: &str, to: *mut T, value: T) -> Result<(), Failure> {
    check(name, to)?;
    // SAFETY: as the caller says.
    unsafe { to.write(value) };
    Ok(())
}

/// Refuses null pointers.
pub(super) fn check<T>(name: &str, pointer: *const T) -> Result<(), Failure> {
    match pointer.is_null() {
        true => Err(Failure::argument(format!("{name}: a null pointer"))),
        false => Ok(()),
    }
}

/// Copies an array of numbers.
///
/// # Safety
/// Null, or valid for reads of `count` elements.
pub(super) unsafe fn numbers<T: bytemuck::Pod>(name: &str, from: *const T, count: usize) -> Result<Vec<T>, Failure> {
    if count == 0 {
        return Ok(Vec::new());
    }
    check(name, from)?;
    let mut copy = vec![T::zeroed(); count];
    // SAFETY: as the caller says; the copy is new.
    unsafe { std::ptr::copy_nonoverlapping(from, copy.as_mut_ptr(), count) };
    Ok(copy)
}

/// A text.
///
/// # Safety
/// Null, or ended by a zero byte.
pub(super) unsafe fn text<'a>(name: &str, from: *const c_char) -> Result<&'a str, Failure> {
    check(name, from)?;
    // SAFETY: as the caller says.
    let text = unsafe { CStr::from_ptr(from) };
    text.to_str()
        .map_err(|_| Failure::argument(format!("{name}: not UTF-8")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    struct Earlier {
        size: u32,
        a: u32,
    }

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    struct Later {
        size: u32,
        a: u32,
        b: [u32; 2],
    }

    sized!(Earlier, Later);

    #[test]
    fn structures_of_earlier_and_later_headers_are_read() {
        let earlier = Earlier { size: 8, a: 5 };
        // SAFETY: a structure of the size that it says, as below.
        let read_later = unsafe { read((&raw const earlier).cast::<Later>()) }.unwrap();
        assert_eq!((read_later.a, read_later.b), (5, [0, 0]));
        let mut later = Later {
            size: 16,
            a: 6,
            b: [0; 2],
        };
        let pointer = &raw mut later;
        // SAFETY: as above.
        let read_earlier = unsafe { read(pointer.cast_const().cast::<Earlier>()) };
        assert_eq!(read_earlier.unwrap().a, 6);
        // SAFETY: as above.
        unsafe { write(pointer.cast::<Earlier>(), &Earlier { size: 1, a: 7 }) }.unwrap();
        assert_eq!(
            later,
            Later {
                size: 16,
                a: 7,
                b: [0; 2]
            }
        );
        later.b[1] = 1;
        // SAFETY: as above.
        let refused = unsafe { read((&raw const later).cast::<Earlier>()) };
        assert!(refused.unwrap_err().message.contains("beyond the 8 bytes"));
    }

    #[test]
    fn arrays_have_the_callers_stride() {
        let two = [
            Later {
                size: 16,
                a: 1,
                b: [0; 2],
            },
            Later {
                size: 16,
                a: 2,
                b: [0; 2],
            },
        ];
        // SAFETY: structures of the size that they say, as below.
        let all = unsafe { array(two.as_ptr().cast::<Earlier>(), 2) }.unwrap();
        assert_eq!(all.iter().map(|one| one.a).collect::<Vec<_>>(), [1, 2]);
        let mixed = [Later { size: 16, ..two[0] }, Later { size: 12, ..two[0] }];
        // SAFETY: as above.
        let refused = unsafe { array(mixed.as_ptr(), 2) };
        assert!(refused.unwrap_err().message.contains("Later 1: another size"));
    }

    #[test]
    fn absent_structures_and_sizes_are_named() {
        // SAFETY: null pointers, and a structure of the size that it says.
        let (null, none, small) = unsafe {
            let small = Later {
                size: 4,
                ..Later::default()
            };
            (
                read::<Later>(std::ptr::null()),
                optional::<Later>(std::ptr::null()),
                read(&raw const small),
            )
        };
        assert_eq!(null.unwrap_err().message, "Later: a null pointer");
        assert_eq!(none.unwrap(), None);
        assert_eq!(
            small.unwrap_err().message,
            "Later: its size is 4; set it to sizeof(Later)"
        );
    }
}
