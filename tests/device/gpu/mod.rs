//! Devices, buffers, recording and frames, independent of splats except for one kernel.

mod images;

use ashfall::Error;
use ashfall::gpu::{Buffer, Frames, Gpu, GpuOptions, Recorder, devices};
use ashfall::kernels::compact::{Bindings, Choice, Compact, Spec};
use ashfall::layout::{COUNT_SLOTS, COUNT_SPLAT};

/// Fill value of fresh buffers under validation: a NaN.
const POISON: u32 = 0x7FC0_DEAD;

fn counting(len: usize) -> Vec<u32> {
    (0..len as u32).collect()
}

fn all(gpu: &Gpu, buffer: &Buffer<u32>) -> Vec<u32> {
    gpu.download(buffer, 0..buffer.len()).unwrap()
}

#[test]
fn what_is_uploaded_comes_back() {
    let gpu = crate::common::device::gpu();
    let bytes: Vec<u8> = (0..13).collect();
    let buffer = gpu.buffer_from("bytes", &bytes).unwrap();
    assert_eq!(gpu.download(&buffer, 0..13).unwrap(), bytes);
    assert_eq!(gpu.download(&buffer, 3..7).unwrap(), bytes[3..7]);
    let vectors = [[1.5f32, -2.0, 3.25], [0.0, f32::MIN_POSITIVE, 7.0]];
    let buffer = gpu.buffer_from("vectors", &vectors).unwrap();
    assert_eq!((buffer.len(), buffer.bytes()), (2, 24));
    assert_eq!(gpu.download(&buffer, 0..2).unwrap(), vectors);
    gpu.upload(&buffer, 1, &[[9.0; 3]]).unwrap();
    assert_eq!(gpu.download(&buffer, 0..2).unwrap(), [vectors[0], [9.0; 3]]);
    // More than one piece of staging, with an odd remainder.
    let many = counting((33 << 18) + 5);
    let buffer = gpu.buffer_from("many", &many).unwrap();
    assert!(all(&gpu, &buffer) == many, "the pieces of a large transfer");
}

#[test]
fn empty_buffers_are_buffers() {
    let gpu = crate::common::device::gpu();
    let buffer = gpu.buffer::<[f32; 4]>("none", 0).unwrap();
    assert!(buffer.is_empty());
    assert_eq!((buffer.len(), buffer.bytes(), buffer.name()), (0, 0, "none"));
    gpu.upload(&buffer, 0, &[]).unwrap();
    assert_eq!(gpu.download(&buffer, 0..0).unwrap(), Vec::<[f32; 4]>::new());
    gpu.run(|rec| {
        rec.fill(&buffer, 1);
        rec.update(&buffer, 0, &[]);
        rec.copy(&buffer, 0..0, &buffer, 0);
    })
    .unwrap();
    gpu.run(|_| {}).unwrap();
}

#[test]
fn fresh_buffers_hold_nans_where_validation_is_on() {
    let gpu = crate::common::device::gpu();
    let buffer = gpu.buffer::<u32>("fresh", 7).unwrap();
    assert_eq!(all(&gpu, &buffer), [POISON; 7]);
}

/// Name, bytes wanted and bytes available of an out-of-memory error.
fn out_of_memory<T>(result: ashfall::Result<T>) -> (String, u64, u64) {
    match result.err() {
        Some(Error::OutOfMemory {
            name,
            wanted,
            available,
        }) => (name, wanted, available),
        other => panic!("not out of memory but {other:?}"),
    }
}

#[test]
fn memory_ends_where_the_user_says() {
    let gpu = crate::common::device::limited(Some(1 << 20));
    assert_eq!(gpu.memory_limit(), 1 << 20);
    let half = gpu.buffer::<u32>("half", 140_000).unwrap();
    let taken = gpu.memory_in_use();
    assert!((1 << 19..1 << 20).contains(&taken), "{taken}");
    let (name, wanted, available) = out_of_memory(gpu.buffer::<u32>("too much", 1 << 18));
    assert_eq!((name.as_str(), available), ("too much", (1 << 20) - taken));
    assert!(wanted >= 1 << 20);
    assert_eq!(gpu.memory_in_use(), taken);
    // Staging counts as well; a recording without staging fails as a whole, and the device stays usable.
    let (name, ..) = out_of_memory(gpu.upload(&half, 0, &counting(140_000)));
    assert_eq!(name, "staging");
    gpu.upload(&half, 0, &[1, 2, 3]).unwrap();
    assert_eq!(gpu.download(&half, 0..3).unwrap(), [1, 2, 3]);
    drop(half);
    assert_eq!(gpu.memory_in_use(), 0);
    assert!((taken..=1 << 20).contains(&gpu.memory_peak()));
}

#[test]
fn a_binding_reaches_only_so_far() {
    let gpu = crate::common::device::gpu();
    let most = gpu.caps().reach();
    for len in [most as usize / 4 + 1, usize::MAX / 2, usize::MAX] {
        let (name, wanted, available) = out_of_memory(gpu.buffer::<u32>("long", len));
        assert_eq!((name.as_str(), available), ("long", most));
        assert!(wanted > most);
    }
    assert_eq!(gpu.memory_in_use(), 0);
}

#[test]
fn commands_of_a_recording_happen_in_order() {
    let gpu = crate::common::device::gpu();
    let a = gpu.buffer::<u32>("a", 8).unwrap();
    let b = gpu.buffer::<u32>("b", 8).unwrap();
    let mut frames = Frames::new(&gpu, 1, false).unwrap();
    let (ticket, (middle, end)) = frames
        .submit(|rec| {
            rec.fill(&a, 7);
            rec.update(&a, 2, &[20, 30]);
            rec.copy(&a, 1..4, &b, 5);
            let middle = rec.read_back(&a, 0..8)?;
            let mut data = [1, 2, 3];
            rec.update(&a, 0, &data);
            // The data is copied at the time of recording.
            data.fill(0);
            rec.copy(&a, 0..3, &a, 5);
            rec.copy(&a, 5..8, &b, 0);
            Ok((middle, rec.read_back(&b, 0..8)?))
        })
        .unwrap();
    frames.wait(ticket).unwrap();
    assert_eq!(middle.get(), [7, 7, 20, 30, 7, 7, 7, 7]);
    assert_eq!(end.get(), [1, 2, 3, POISON, POISON, 7, 20, 30]);
    // A large update after a small one, beyond a chunk of staging.
    let many = counting(100_000);
    let large = gpu.buffer::<u32>("large", many.len()).unwrap();
    gpu.run(|rec| {
        rec.update(&a, 0, &[5]);
        rec.update(&large, 0, &many);
        rec.update(&a, 1, &[6]);
    })
    .unwrap();
    assert!(all(&gpu, &large) == many);
    assert_eq!(gpu.download(&a, 0..2).unwrap(), [5, 6]);
}

#[test]
fn frames_take_turns_and_what_they_read_stays() {
    let gpu = crate::common::device::gpu();
    let buffer = gpu.buffer::<u32>("counter", 1).unwrap();
    let mut frames = Frames::new(&gpu, 3, false).unwrap();
    assert_eq!(frames.in_flight(), 3);
    let mut warm = 0;
    let submitted: Vec<_> = (0..10)
        .map(|i| {
            let record = |rec: &mut Recorder<'_>| {
                rec.update(&buffer, 0, &[i]);
                rec.read_back(&buffer, 0..1)
            };
            let (ticket, value) = frames.submit(record).unwrap();
            // Waiting for a frame frees its slot, so that memory stays constant.
            if i < 6 {
                frames.wait(ticket).unwrap();
                assert_eq!(value.get(), [i]);
                if i == 2 {
                    warm = gpu.memory_in_use();
                }
                assert!(i < 3 || gpu.memory_in_use() == warm, "frame {i}");
                return (ticket, None);
            }
            (ticket, Some(value))
        })
        .collect();
    let last = submitted.last().unwrap().0;
    frames.wait(last).unwrap();
    assert!(submitted.iter().all(|(ticket, _)| frames.is_done(*ticket).unwrap()));
    // Values kept past the reuse of their slots are still those of their frame.
    for (i, (_, value)) in submitted.into_iter().enumerate() {
        assert!(value.is_none_or(|value| value.get() == [i as u32]));
    }
}

#[test]
fn a_recording_that_fails_is_not_submitted() {
    let gpu = crate::common::device::gpu();
    let buffer = gpu.buffer_from("kept", &[1u32]).unwrap();
    let mut frames = Frames::new(&gpu, 2, false).unwrap();
    for _ in 0..3 {
        let failed = frames.submit(|rec| -> ashfall::Result<()> {
            rec.fill(&buffer, 2);
            Err(Error::Config("changed my mind".into()))
        });
        assert_eq!(failed.unwrap_err().to_string(), "changed my mind");
    }
    let (ticket, value) = frames.submit(|rec| rec.read_back(&buffer, 0..1)).unwrap();
    frames.wait(ticket).unwrap();
    assert_eq!(value.get(), [1]);
}

#[test]
fn timestamps_are_filed_under_their_labels() {
    let gpu = crate::common::device::gpu();
    let buffer = gpu.buffer::<u32>("filled", 1 << 20).unwrap();
    let record = |rec: &mut Recorder<'_>| {
        rec.fill(&buffer, 1);
        rec.timestamp("fill");
        rec.timestamp("nothing");
        Ok(())
    };
    let mut frames = Frames::new(&gpu, 2, true).unwrap();
    let (first, ()) = frames.submit(record).unwrap();
    let (second, ()) = frames
        .submit(|rec| {
            (0..500).for_each(|_| rec.timestamp("too many"));
            Ok(())
        })
        .unwrap();
    let times = frames.timings(first).unwrap();
    let labels: Vec<_> = times.iter().map(|(label, _)| *label).collect();
    assert_eq!(labels, ["fill", "nothing"]);
    assert!(times[0].1 > 0.0 && times[0].1 < 60e9, "{times:?}");
    // Spans of one label are one; marks beyond the frame's capacity are dropped.
    let times = frames.timings(second).unwrap();
    assert!(matches!(times[..], [("too many", span)] if span >= 0.0), "{times:?}");
    let mut frames = Frames::new(&gpu, 1, false).unwrap();
    let (ticket, ()) = frames.submit(record).unwrap();
    assert_eq!(frames.timings(ticket).unwrap(), []);
}

/// One workgroup per splat, more of them than many devices allow in one grid dimension.
#[test]
fn a_dispatch_beyond_a_dimensions_limit_is_folded() {
    let gpu = crate::common::device::gpu();
    let count = 2 * 65_535 + 3;
    let choice = Choice {
        spec: Spec { workgroup: 1 },
        ..Choice::default()
    };
    let compact = Compact::new(&gpu, choice).unwrap();
    let mut counts = [0u32; COUNT_SLOTS as usize];
    counts[COUNT_SPLAT as usize] = count as u32;
    // Reversed order, so that every splat is distinguished.
    let offsets: Vec<u32> = (0..count as u32).rev().collect();
    let counts = gpu.buffer_from("counts", &counts).unwrap();
    let ones = gpu.buffer_from("tile_count_from_splat", &vec![1u32; count]).unwrap();
    let offsets = gpu.buffer_from("visible_from_splat", &offsets).unwrap();
    let rests = gpu
        .buffer_from("blue_depth_from_splat", &vec![[0.0f32; 2]; count])
        .unwrap();
    let depths = gpu.buffer::<u32>("depth_from_visible", count).unwrap();
    let splats = gpu.buffer::<u32>("splat_from_visible", count).unwrap();
    gpu.run(|rec| {
        let io = Bindings {
            counts: &counts,
            tile_count_from_splat: &ones,
            visible_from_splat: &offsets,
            blue_depth_from_splat: &rests,
            depth_from_visible: &depths,
            splat_from_visible: &splats,
        };
        compact.record(rec, io, compact.groups(count));
    })
    .unwrap();
    let listed = all(&gpu, &splats);
    assert!((0..count).all(|i| listed[i] as usize == count - 1 - i));
}

#[test]
fn buffers_outlive_their_handles_while_commands_use_them() {
    let gpu = crate::common::device::gpu();
    let mut frames = Frames::new(&gpu, 2, false).unwrap();
    let result = gpu.buffer::<u32>("result", 1).unwrap();
    let before = gpu.memory_in_use();
    let many = 1 << 20;
    let (ticket, value) = {
        let from = gpu.buffer::<u32>("from", many).unwrap();
        let to = gpu.buffer::<u32>("to", many).unwrap();
        frames
            .submit(|rec| {
                rec.fill(&from, 11);
                rec.copy(&from, 0..many, &to, 0);
                rec.copy(&to, many - 1..many, &result, 0);
                rec.read_back(&result, 0..1)
            })
            .unwrap()
    };
    assert!(gpu.memory_in_use() >= before + 8 * many as u64);
    frames.wait(ticket).unwrap();
    assert_eq!(value.get(), [11]);
    // They are freed when their slot is reused.
    for _ in 0..2 {
        frames.submit(|_| Ok(())).unwrap();
    }
    assert!(gpu.memory_in_use() < before + many as u64);
}

#[test]
fn two_devices_work_side_by_side() {
    let both: Vec<_> = (0..2)
        .map(|i| {
            std::thread::spawn(move || {
                let gpu = crate::common::device::gpu();
                let buffer = gpu.buffer::<u32>("mine", 1000).unwrap();
                for round in 0..20 {
                    gpu.run(|rec| rec.fill(&buffer, 100 * i + round)).unwrap();
                    assert_eq!(all(&gpu, &buffer), vec![100 * i + round; 1000]);
                }
                // A device is destroyed with its last handle, in any order.
                let clone = gpu.clone();
                (buffer, clone)
            })
        })
        .collect();
    for thread in both {
        let (buffer, gpu) = thread.join().unwrap();
        assert_eq!(all(&gpu, &buffer).len(), 1000);
        drop(gpu);
        drop(buffer);
    }
}

#[test]
fn devices_are_chosen_by_index_or_name() {
    let _turn = crate::common::device::turn();
    let caps = devices().unwrap();
    let choose = |device: &str| {
        Gpu::create(&GpuOptions {
            device: Some(device.into()),
            ..GpuOptions::default()
        })
    };
    assert_eq!(choose("0").unwrap().caps().name, caps[0].name);
    let part = caps[0].name[..4].to_uppercase();
    assert!(choose(&part).unwrap().caps().name.starts_with(&caps[0].name[..4]));
    for wrong in ["no such device", "4096", "-1"] {
        let text = choose(wrong).unwrap_err().to_string();
        assert!(text.contains(wrong), "{text}");
        for (i, caps) in caps.iter().enumerate() {
            assert!(text.contains(&format!("{i}: {}", caps.name)), "{text}");
        }
    }
}
