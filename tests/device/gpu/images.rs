//! Images created by the engine.

use crate::common::device;
use crate::gpu::out_of_memory;
use ashfall::gpu::Frames;

#[test]
fn images_are_cleared_copied_counted_and_outlive_their_handles() {
    let gpu = device::gpu();
    let (size, pixels) = ([5, 3], 15);
    let image = gpu.image("picture", size).unwrap();
    assert_eq!(image.extent(), size);
    let fresh = gpu.download_image(&image).unwrap();
    assert!(fresh.len() == pixels && fresh.iter().flatten().all(|value| value.is_nan()));
    let by_name = gpu.memory_by_name();
    let counted = by_name.iter().find(|(name, _)| name == "picture").unwrap().1;
    assert!(counted.bytes >= 16 * pixels as u64, "{counted:?}");
    let copy = gpu.buffer::<[f32; 4]>("copy", pixels + 1).unwrap();
    let mut frames = Frames::new(&gpu, 1, false).unwrap();
    let (ticket, read) = frames
        .submit(|rec| {
            rec.clear(&image, 0.25);
            rec.clear(&image, 1.5);
            rec.copy_image(&image, &copy);
            rec.clear(&image, 0.5);
            let read = rec.read_back(&copy, 0..pixels + 1);
            drop(image);
            read
        })
        .unwrap();
    frames.wait(ticket).unwrap();
    let found = read.get();
    assert_eq!(found[..pixels], vec![[1.5; 4]; pixels]);
    assert!(found[pixels][0].is_nan(), "a pixel too many");
    drop((frames, read, copy));
    assert_eq!(gpu.memory_in_use(), 0);
    for size in [[0, 4], [4, u32::MAX]] {
        let refused = gpu.image("picture", size).unwrap_err().to_string();
        assert!(refused.contains("picture: an image of"), "{refused}");
    }
    let small = device::limited(Some(1 << 20));
    assert_eq!(out_of_memory(small.image("much", [512, 512])).0, "much");
    assert_eq!(small.memory_in_use(), 0);
}
