//! `ashfall mesh` and `ashfall eval --mesh` on a ball of discs.

use super::*;
use ashfall::io;
use ashfall::lab::synth::icosphere;
use ashfall::scene::Splats;
use glam::{DQuat, DVec3};

/// Where the ball is; in sight of all cameras.
const PLACE: DVec3 = DVec3::new(0.1, -0.1, 0.5);

/// Discs on a sphere of radius 1, on a spiral, opaque and grey.
fn ball(path: &Path) {
    let count = 3_000;
    let mut splats = Splats::default();
    for i in 0..count {
        let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(count);
        let (angle, flat) = (2.399_963 * f64::from(i), (1.0 - z * z).sqrt());
        let normal = DVec3::new(flat * angle.cos(), flat * angle.sin(), z);
        let q = DQuat::from_rotation_arc(DVec3::Z, normal);
        splats.mean.push((PLACE + normal).as_vec3().to_array());
        splats.quaternion.push([q.w, q.x, q.y, q.z].map(|x| x as f32));
        splats.log_scale.push([0.05f32.ln(), 0.05f32.ln(), 0.002f32.ln()]);
        splats.opacity_logit.push(4.0);
        splats.sh.extend([0.0; 3].iter().take(splats.sh_stride()));
    }
    io::splats::write(path, &splats).unwrap();
}

fn truth(path: &Path) {
    let mut mesh = icosphere(5);
    for position in &mut mesh.positions {
        *position = (DVec3::from(position.map(f64::from)) + PLACE).as_vec3().to_array();
    }
    io::mesh::write(path, &mesh, DVec3::ZERO).unwrap();
}

#[test]
fn a_ball_becomes_a_mesh_and_is_scored() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let (scene, true_mesh) = (path("scene.ply"), path("true.obj"));
    ball(&scene);
    truth(&true_mesh);
    let data = word(data());
    let fuse = |out: &Path, more: &[&str]| -> Value {
        let call = ["mesh", word(&scene), data, "--out", word(out), "--json"];
        json(&stdout(&[&call[..], more].concat()))
    };
    let mesh = path("mesh.ply");
    let made = fuse(&mesh, &["--largest", "1"]);
    assert!(made["triangles"].as_u64().is_some_and(|t| t > 500), "{made}");
    let first = fs::read(&mesh).unwrap();
    fuse(&mesh, &["--largest", "1", "--volume-memory", "4M"]);
    assert!(fs::read(&mesh).unwrap() == first, "not the same bytes twice");
    for name in ["mesh.obj", "mesh.glb"] {
        fuse(&path(name), &["--depth", "expected"]);
        assert!(path(name).is_file());
    }
    let small = path("small.ply");
    let pictures = path("pictures");
    let made = fuse(
        &small,
        &["--closed", "--triangles", "300", "--pictures", word(&pictures)],
    );
    let scores = &made["scores"];
    // The photographs show another scene, so that only mesh and splats are alike.
    let [of_mesh, of_splats] = ["mesh", "splats"].map(|of| scores[of]["psnr_db"].as_f64().unwrap());
    assert!(
        scores["mesh"]["views"] == 2 && (of_mesh - of_splats).abs() < 1.0,
        "{made}"
    );
    // The ball is 17 of 45 × 34 pixels wide, and its mesh covers no more than that.
    let of_covered = |key: &str| scores["covered"][key].as_f64().unwrap();
    assert!((0.11..0.18).contains(&of_covered("share")), "{made}");
    let [of_mesh, of_splats] = ["mesh_psnr_db", "splats_psnr_db"].map(of_covered);
    assert!((of_mesh - of_splats).abs() < 1.0, "{made}");
    let files: Vec<_> = fs::read_dir(&pictures).unwrap().collect();
    assert_eq!(files.len(), 2);
    let picture = image::open(files[0].as_ref().unwrap().path()).unwrap();
    assert_eq!((picture.width(), picture.height()), (4 * 45 + 3 * 4, 34));
    assert!(
        made["triangles"].as_u64().is_some_and(|t| (200..=300).contains(&t)),
        "{made}"
    );
    let score = |mesh: &Path, more: &[&str]| -> Value {
        let call = [
            "eval",
            "--mesh",
            word(mesh),
            "--truth",
            word(&true_mesh),
            "--json",
            "--points",
            "20000",
        ];
        json(&stdout(&[&call[..], more].concat()))["comparison"].take()
    };
    let found = score(&mesh, &["--cameras", data]);
    let number = |value: &Value, pointer: &str| value.pointer(pointer).and_then(Value::as_f64).unwrap();
    let pixel = number(&found, "/footprint");
    println!("{found:#}");
    assert!((0.08..0.2).contains(&pixel), "{found}");
    // The ball is 17 pixels wide, and its outline, where discs are drawn wider than they are, a pixel.
    assert!(number(&found, "/chamfer") < 0.5 * pixel, "{found}");
    assert!(
        number(&found, "/scores/1/f1") > 0.95 && number(&found, "/normal_deg/mean_outward") < 20.0,
        "{found}"
    );
    let same = score(&true_mesh, &[]);
    assert!(
        number(&same, "/chamfer") < 1e-6 && number(&same, "/scores/0/f1") == 1.0,
        "{same}"
    );
    let text = stdout(&[
        "eval",
        "--mesh",
        word(&mesh),
        "--truth",
        word(&true_mesh),
        "--threshold",
        "0.1",
    ]);
    assert!(text.contains("chamfer") && text.contains("within 1.000e-1"), "{text}");
}

#[test]
fn faults_of_meshes_are_told_and_leave_no_file() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let (scene, empty) = (path("scene.ply"), path("empty.ply"));
    ball(&scene);
    io::splats::write(&empty, &Splats::default()).unwrap();
    let data = word(data());
    let told = |scene: &Path, out: &str, more: &[&str]| -> String {
        let out = path(out);
        let call = ["mesh", word(scene), data, "--out", word(&out)];
        let told = error(&[&call[..], more].concat());
        assert!(!out.exists(), "a file was left");
        told
    };
    assert!(told(&scene, "a.stl", &[]).contains(".ply, .obj or .glb"));
    assert!(told(&scene, "none/a.ply", &[]).contains("none"));
    assert!(told(&empty, "a.ply", &[]).contains("no view has a surface"));
    assert!(told(&scene, "a.ply", &["--voxel", "1e-4", "--volume-memory", "1M"]).contains("--voxel"));
    // Cameras that look elsewhere.
    let far = path("far.json");
    let text = fs::read_to_string(Path::new(data).join("transforms.json")).unwrap();
    let mut frames = json(&text);
    for frame in frames["frames"].as_array_mut().unwrap() {
        frame["transform_matrix"][0][3] = (1e4).into();
    }
    fs::write(&far, frames.to_string()).unwrap();
    let out = path("b.ply");
    let elsewhere = error(&["mesh", word(&scene), word(&far), "--out", word(&out)]);
    assert!(
        elsewhere.contains("no view has a surface") && !out.exists(),
        "{elsewhere}"
    );
    let missing = path("missing.ply");
    assert!(error(&["eval", "--mesh", word(&missing), "--truth", word(&scene)]).contains("missing.ply"));
    assert!(error(&["eval", "--mesh", word(&scene), "--truth", word(&scene)]).contains("no mesh"));
    assert_eq!(run(&["eval", "--mesh", word(&scene)]).status.code(), Some(2));
    assert_eq!(run(&["eval", word(&scene)]).status.code(), Some(2));
}
