//! Photographs: file formats, sizes and memory.

use crate::io::{error_at, for_every_prefix, shared};
use ashfall::io::photo::{self, PhotoCache};
use ashfall::scene::{Camera, Dataset, Distortion, Lens, Optics, Photo, PhotoSource, View};
use glam::{DMat3, DVec2, DVec3};
use std::path::{Path, PathBuf};

pub(crate) fn camera(width: u32, height: u32) -> Camera {
    let size = DVec2::new(width.into(), height.into());
    Camera {
        width,
        height,
        focal: DVec2::splat(0.9 * size.x),
        center: size * DVec2::new(0.48, 0.53),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

pub(crate) fn view(path: &Path, camera: Camera, distortion: Option<Distortion>) -> View {
    View {
        name: "a view".into(),
        camera,
        photo: PhotoSource::File {
            path: path.into(),
            optics: distortion.map(|distortion| Box::new(Optics::of(Lens::Brown(distortion), &camera))),
            orientation: 1,
            mask: None,
            vignetting: None,
        },
    }
}

pub(crate) fn save<P: image::PixelWithColorType>(folder: &Path, name: &str, pixel: impl Fn(u32, u32) -> P) -> PathBuf
where
    [P::Subpixel]: image::EncodableLayout,
{
    let path = folder.join(name);
    image::ImageBuffer::from_fn(8, 4, pixel).save(&path).unwrap();
    path
}

#[test]
fn every_kind_of_file_becomes_rgba() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let decoded = |path: PathBuf| {
        let photo = photo::decode(&path).unwrap();
        assert_eq!((photo.width, photo.height), (8, 4));
        photo.rgba[9]
    };
    let grey = save(folder, "grey.png", |x, y| image::Luma([(10 * x + y) as u8]));
    assert_eq!(decoded(grey), [11, 11, 11, 255]);
    let alpha = save(folder, "alpha.png", |x, y| image::LumaA([(10 * x + y) as u8, 77]));
    assert_eq!(decoded(alpha), [11, 11, 11, 77]);
    let deep = save(folder, "deep.png", |_, _| image::Luma([257u16 * 40 + 128]));
    assert_eq!(decoded(deep), [40, 40, 40, 255], "rounded from 16 bits");
    let deep = save(folder, "deep3.png", |_, _| image::Rgb([65535u16, 257, 0]));
    assert_eq!(decoded(deep), [255, 1, 0, 255]);
    let deep = save(folder, "deep4.png", |_, _| image::Rgba([65535u16, 257, 0, 257 * 3]));
    assert_eq!(decoded(deep), [255, 1, 0, 3]);
    let rgb = save(folder, "rgb.png", |x, y| image::Rgb([x as u8, y as u8, 9]));
    assert_eq!(decoded(rgb), [1, 1, 9, 255]);
    let jpeg = save(folder, "flat.jpg", |_, _| image::Rgb([100u8, 150, 200]));
    let [r, g, b, a] = decoded(jpeg);
    assert!(r.abs_diff(100) < 4 && g.abs_diff(150) < 4 && b.abs_diff(200) < 4 && a == 255);
    let jpeg = save(folder, "grey.jpg", |_, _| image::Luma([100u8]));
    assert_eq!(decoded(jpeg), [100, 100, 100, 255]);
    let palette = folder.join("palette.png");
    std::fs::write(&palette, palette_png()).unwrap();
    assert_eq!(decoded(palette), [1, 101, 201, 255]);
    // A JPEG file with the wrong extension is decoded as JPEG.
    std::fs::rename(folder.join("flat.jpg"), folder.join("flat.png")).unwrap();
    photo::decode(&folder.join("flat.png")).unwrap();
}

/// An 8 × 4 image of palette indices by column, index i with the colour (i, 100 + i, 200 + i).
fn palette_png() -> Vec<u8> {
    let rows: Vec<u8> = (0..4).flat_map(|_| [0, 0, 1, 2, 3, 4, 5, 6, 7]).collect();
    let palette: Vec<u8> = (0..8).flat_map(|i| [i, 100 + i, 200 + i]).collect();
    // One stored block of zlib, with its Adler-32.
    let length = rows.len() as u16;
    let (mut a, mut b) = (1u32, 0u32);
    for byte in &rows {
        a = (a + u32::from(*byte)) % 65521;
        b = (b + a) % 65521;
    }
    let mut zlib = vec![0x78, 0x01, 0x01];
    zlib.extend(length.to_le_bytes());
    zlib.extend((!length).to_le_bytes());
    zlib.extend(&rows);
    zlib.extend(((b << 16) | a).to_be_bytes());
    png_of(8, 4, 3, &[(b"PLTE", &palette), (b"IDAT", &zlib), (b"IEND", &[])])
}

fn png_of(width: u32, height: u32, color: u8, chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut head = [width.to_be_bytes(), height.to_be_bytes()].concat();
    head.extend([8, color, 0, 0, 0]);
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (name, contents) in [(b"IHDR", &head[..])].iter().chain(chunks) {
        file.extend((contents.len() as u32).to_be_bytes());
        let body = [&name[..], contents].concat();
        file.extend(&body);
        file.extend(crc32fast::hash(&body).to_be_bytes());
    }
    file
}

#[test]
fn sizes_no_photograph_has_are_refused_before_decoding() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.png");
    for (width, height) in [
        (u32::MAX, u32::MAX),
        (65_535, 65_535),
        (65_536, 2),
        (0, 5),
        (1, 1),
        (5, 1),
    ] {
        std::fs::write(&path, png_of(width, height, 2, &[(b"IDAT", &[0; 9]), (b"IEND", &[])])).unwrap();
        let text = error_at(photo::decode(&path), &path);
        assert!(text.contains(&format!("{width} x {height}")), "{text}");
    }
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.png", "a.jpg"] {
        let path = save(folder.path(), name, |x, y| {
            image::Rgb([(x * 30) as u8, (y * 60) as u8, 7])
        });
        let contents = std::fs::read(&path).unwrap();
        // The last chunk of a PNG file is empty.
        let needed = if name == "a.png" {
            contents.len() - 12
        } else {
            contents.len()
        };
        for_every_prefix(
            &contents,
            &path,
            |path| photo::decode(path),
            |length, result| {
                if length < needed {
                    error_at(result, &path);
                }
            },
        );
        for at in 0..contents.len() {
            let mut damaged = contents.clone();
            damaged[at] ^= 0xff;
            std::fs::write(&path, damaged).unwrap();
            _ = photo::decode(&path);
        }
    }
}

#[test]
fn orientation_in_exif_is_not_applied() {
    let folder = tempfile::tempdir().unwrap();
    let path = save(folder.path(), "a.jpg", |x, _| image::Rgb([(x * 30) as u8; 3]));
    let plain = photo::decode(&path).unwrap();
    // Tag 0x0112, SHORT, one value: 6, "rotate by 90 degrees".
    let exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let contents = std::fs::read(&path).unwrap();
    let mut tagged = contents[..2].to_vec();
    tagged.extend([0xff, 0xe1]);
    tagged.extend((exif.len() as u16 + 2).to_be_bytes());
    tagged.extend(exif);
    tagged.extend(&contents[2..]);
    std::fs::write(&path, tagged).unwrap();
    assert_eq!(photo::decode(&path).unwrap(), plain);
}

#[test]
fn files_of_another_aspect_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = save(folder.path(), "a.png", |_, _| image::Luma([1u8]));
    let text = error_at(photo::load(&view(&path, camera(4, 8), None)), &path);
    assert!(text.contains("8 x 4") && text.contains("4 x 8"), "{text}");
    let absent = View {
        photo: PhotoSource::Absent,
        ..view(&path, camera(8, 4), None)
    };
    assert!(photo::load(&absent).unwrap_err().to_string().contains("a view"));
}

#[test]
fn the_cache_keeps_to_its_budget() {
    let folder = tempfile::tempdir().unwrap();
    let path = save(folder.path(), "a.png", |x, y| image::Rgb([x as u8, y as u8, 0]));
    let data = Dataset {
        views: vec![view(&path, camera(8, 4), None); 5],
        ..Dataset::default()
    };
    let each = 8 * 4 * 4;
    let cache = PhotoCache::new(&data, 3 * each + 1);
    assert_eq!(cache.load_all(&data, &[4, 3, 2, 1, 0]).unwrap(), 3);
    assert_eq!(cache.kept_bytes(), 3 * each);
    // All photographs are available, but no more are cached.
    for index in 0..5 {
        assert_eq!(
            *cache.get(&data, index).unwrap(),
            photo::load(&data.views[index]).unwrap()
        );
    }
    assert_eq!(cache.kept_bytes(), 3 * each);
    // Cached photographs remain available without the file.
    std::fs::remove_file(&path).unwrap();
    cache.get(&data, 4).unwrap();
    assert!(error_at(cache.get(&data, 0), &path).contains("a.png"));
    let empty = PhotoCache::new(&data, 0);
    assert_eq!(empty.load_all(&data, &[0, 1]).unwrap(), 0);
    let full = PhotoCache::new(&data, u64::MAX);
    error_at(full.load_all(&data, &[0, 1]), &path);
}

#[test]
fn the_odd_files_of_the_corpus_show_the_same_picture() {
    let Some(broken) = shared("broken") else {
        return;
    };
    let mean = |a: &Photo, b: &Photo, grey: bool| -> f64 {
        let luma = |p: &[u8; 4]| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
        let difference = |(a, b): (&[u8; 4], &[u8; 4])| match grey {
            true => (luma(a) - luma(b)).abs(),
            false => (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>() / 3.0,
        };
        a.rgba.iter().zip(&b.rgba).map(difference).sum::<f64>() / a.rgba.len() as f64
    };
    for case in ["ok_colmap_image_cmyk", "ok_colmap_image_grayscale"] {
        for entry in std::fs::read_dir(broken.join(case).join("images")).unwrap() {
            let path = entry.unwrap().path();
            let good = broken.join("00_good_colmap/images").join(path.file_name().unwrap());
            let (odd, good) = (photo::decode(&path).unwrap(), photo::decode(&good).unwrap());
            let difference = mean(&odd, &good, case.ends_with("grayscale"));
            assert!(difference < 6.0, "{}: {difference}", path.display());
        }
    }
}
