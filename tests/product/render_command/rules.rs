//! `--rendering`.

use std::collections::BTreeMap;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::*;

const CAMERA: &str = r#"{"width":9,"height":7,"K":[20,0,4.5,0,20,3.5,0,0,1],
    "camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#;

/// One Gaussian of opacity 0.5 in the middle, 2 m ahead, with harmonics of degree 1.
fn write_scene(dir: &Path) {
    std::fs::write(dir.join("cam.json"), CAMERA).unwrap();
    let arrays: [(&str, Vec<usize>, Vec<f32>); 5] = [
        ("means", vec![1, 3], vec![0.0, 0.0, 2.0]),
        ("quats_wxyz", vec![1, 4], vec![2.0, 0.0, 0.0, 0.0]),
        ("scales", vec![1, 3], vec![0.05; 3]),
        ("opacities", vec![1], vec![0.5]),
        // Straight ahead, only the second coefficient of degree 1 has an effect: 0.4886.
        (
            "sh",
            vec![1, 4, 3],
            vec![1.0, 0.0, -4.0, 9.0, 9.0, 9.0, 0.5, 3.0, 0.5, 9.0, 9.0, 9.0],
        ),
    ];
    let bytes = arrays.map(|(name, shape, values)| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        (name, shape, bytes)
    });
    let views = bytes.iter().map(|(name, shape, bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
        (*name, view)
    });
    let file = safetensors::serialize(views, None).unwrap();
    std::fs::write(dir.join("scene.safetensors"), file).unwrap();
}

fn of_arrays(dir: &Path, more: &[&str]) -> Said {
    let fixed = words("render scene.safetensors --camera cam.json --backend cpu");
    sharp_bench(dir, &[&fixed, more].concat())
}

/// The tensors of a file at the middle pixel.
fn middle(path: impl AsRef<Path>) -> BTreeMap<String, Vec<f32>> {
    let bytes = bytes(path);
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let tensors = file.tensors().into_iter();
    tensors
        .map(|(name, tensor)| {
            let values = tensor.data().as_chunks::<4>().0.iter();
            let values: Vec<f32> = values.map(|b| f32::from_le_bytes(*b)).collect();
            let each = values.len() / 63;
            (name, values[31 * each..32 * each].to_vec())
        })
        .collect()
}

#[test]
fn harmonics_are_blended_as_encoded_values_over_the_background() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_scene(dir);
    let out = ["--out", "x.safetensors", "--background", "0.2,0.4,1"];
    of_arrays(
        dir,
        &[&["--rendering", "gsplat-classic"], &out[..]].concat(),
    )
    .ends_with(0);
    let found = middle(dir.join("x.safetensors"));
    let names: Vec<&str> = found.keys().map(String::as_str).collect();
    assert_eq!(names, ["alpha", "depth_acc", "rgb"]);
    assert!((found["alpha"][0] - 0.5).abs() < 1e-6);
    assert!((found["depth_acc"][0] - 1.0).abs() < 1e-6);
    // ½ + 0.28209 c0 + 0.48860 c2, clipped below 0 but not above 1.
    let colors = [1.026_396, 1.965_808, 0.0];
    for (channel, behind) in [0.2, 0.4, 1.0].into_iter().enumerate() {
        let expected = 0.5 * colors[channel] + 0.5 * behind;
        assert!((found["rgb"][channel] - expected).abs() < 1e-5, "{found:?}");
    }
    // The picture is the blended result in 8 bit.
    let out = ["--out", "x.png", "--background", "0.2,0.4,1"];
    of_arrays(
        dir,
        &[&["--rendering", "gsplat-classic"], &out[..]].concat(),
    )
    .ends_with(0);
    let picture = picture(dir.join("x.png"));
    assert_eq!(picture.get_pixel(4, 3).0, [156, 255, 128]);
    assert_eq!(picture.get_pixel(0, 0).0, [51, 102, 255]);
    // Setting single choices by `--rendering` has the same effect as the options for them.
    let dc = "gsplat-classic,degree=0";
    let said = of_arrays(dir, &["--rendering", dc, "--out", "dc.safetensors"]);
    assert!(said.ends_with(0).err.contains("above degree 0"));
    let dc = middle(dir.join("dc.safetensors"));
    assert!((dc["rgb"][0] - 0.5 * 0.782_095).abs() < 1e-5, "{dc:?}");
    let near = ["--rendering", "inria,near=3", "--out", "near.safetensors"];
    of_arrays(dir, &near).ends_with(0);
    let option = words("--rendering inria --near 3 --out option.safetensors");
    of_arrays(dir, &option).ends_with(0);
    assert_eq!(middle(dir.join("near.safetensors"))["alpha"], [0.0]);
    assert_eq!(
        bytes(dir.join("near.safetensors")),
        bytes(dir.join("option.safetensors"))
    );
}

#[test]
fn what_a_rule_does_not_draw_is_refused() {
    let dir = folder();
    let dir = dir.path();
    write_scene(dir);
    of_arrays(dir, &["--out", "x.png"]).is_error_with(&["scene.safetensors", "--rendering"]);
    let inria = ["--rendering", "inria"];
    of_arrays(dir, &[&inria[..], &["--out", "x.exr"]].concat()).is_error_with(&["x.exr", "inria"]);
    // SHARP's rule given by name, and SHARP's colours with another rule.
    render(dir, &["--out", "a.png"]).ends_with(0);
    render(dir, &["--out", "b.png", "--rendering", "sharp"]).ends_with(0);
    assert_eq!(bytes(dir.join("a.png")), bytes(dir.join("b.png")));
    render(
        dir,
        &["--out", "c.png", "--rendering", "sharp,blending=srgb"],
    )
    .ends_with(0);
    assert_ne!(bytes(dir.join("a.png")), bytes(dir.join("c.png")));
}
