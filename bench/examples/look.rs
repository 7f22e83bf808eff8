use image::{Rgb, RgbImage, imageops};
use sharp_bench::record::*;
use sharp_bench::report::*;
use sharp_metrics::MetricKey;
use std::collections::BTreeMap;
use std::path::Path;

struct P {
    im: Vec<RgbImage>,
}
fn shift(im: &RgbImage, d: i64) -> RgbImage {
    RgbImage::from_fn(im.width(), im.height(), |x, y| {
        let s = (x as i64 + d).clamp(0, im.width() as i64 - 1) as u32;
        *im.get_pixel(s, y)
    })
}
impl Pictures for P {
    fn source(&self, r: &Record) -> Result<RgbImage, String> {
        Ok(shift(&self.im[0], (r.baseline_m * 40.0) as i64))
    }
    fn target(&self, r: &Record) -> Result<RgbImage, String> {
        if r.scene.contains("nopic") {
            Err("target not readable: truncated PNG".into())
        } else {
            Ok(self.im[1].clone())
        }
    }
    fn prediction(&self, r: &Record) -> Result<RgbImage, String> {
        Ok(match r.method.as_str() {
            "target" => self.im[1].clone(),
            "copy" => self.source(r)?,
            "mean" => {
                RgbImage::from_pixel(self.im[0].width(), self.im[0].height(), Rgb([110, 105, 99]))
            }
            "not-kept" => return Err("not kept (--keep worst:8)".into()),
            "other" => imageops::blur(&self.im[0], 3.0),
            _ => imageops::blur(&self.im[1], 0.8),
        })
    }
}
fn hash(mut x: u64) -> f64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58476d1ce4e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d049bb133111eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
fn main() {
    let arg: Vec<String> = std::env::args().collect();
    let big = arg.get(2).is_some_and(|a| a == "big");
    let d = "/work/shared/samples/middlebury/Motorcycle-quarter/";
    let im: Vec<RgbImage> = ["im0.png", "im1.png"]
        .iter()
        .map(|f| image::open(format!("{d}{f}")).unwrap().to_rgb8())
        .collect();
    let sets: Vec<(&str, usize, f64)> = if big {
        vec![
            ("middlebury", 23, 0.2),
            ("booster", 38, 0.12),
            ("scannetpp", 512, 2.2),
            ("wildrgbd", 512, 0.8),
            ("tanks_and_temples", 512, 4.0),
            ("eth3d", 300, 6.0),
        ]
    } else {
        vec![("middlebury", 1, 0.193), ("synthetic", 24, 0.6)]
    };
    let methods: Vec<&str> = if big {
        vec![
            "sharp",
            "flash3d",
            "gen3c",
            "viewcrafter",
            "lvsm",
            "svc",
            "tmpi",
            "depth-splat",
            "copy",
        ]
    } else {
        vec!["depth-splat", "copy", "mean", "other", "target"]
    };
    let mut records = vec![];
    for (name, n, far) in &sets {
        for i in 0..*n {
            let b = if *n == 1 {
                *far
            } else {
                let u = hash(i as u64 * 7 + n.wrapping_mul(13) as u64 + 1);
                far * u * u
            };
            for (m, method) in methods.iter().enumerate() {
                let r = hash((i * 31 + m * 1009 + n * 77) as u64) - 0.5;
                let q = m as f64 * 0.6 + b / far * 6.0;
                let psnr = if *method == "target" {
                    f64::INFINITY
                } else {
                    28.0 - q * 1.4 + r * 4.0
                };
                let mut scores = BTreeMap::new();
                scores.insert("psnr".into(), Score::Value(psnr));
                scores.insert(
                    "ssim[gauss11,valid]".into(),
                    Score::Value(if psnr.is_infinite() {
                        1.0
                    } else {
                        0.95 - q * 0.03 + r * 0.05
                    }),
                );
                for k in ["lpips[alex,v0.1]", "dists"] {
                    scores.insert(k.into(), if big { Score::Value(0.1 + q * 0.04 + r * 0.05) } else { Score::Unavailable { unavailable: format!("its weights are not here; get them with `sharp-bench weights fetch {}`", if k == "dists" { "dists" } else { "lpips-alex" }) } });
                }
                let failed = *method == "other" && i == 3;
                records.push(Record {
                    pair_id: format!("{name}/scene{}/v{:02}__v{:02}", i / 10, i % 10, i % 10 + 1),
                    dataset: (*name).into(),
                    scene: if *n == 1 {
                        "Motorcycle".into()
                    } else {
                        format!("scene{}", i / 10)
                    },
                    cluster: "c".into(),
                    source: format!("v{:02}", i % 10),
                    target: format!("v{:02}", i % 10 + 1),
                    method: (*method).into(),
                    baseline_m: b,
                    rotation_deg: b * 9.0,
                    median_depth_m: Some(2.9),
                    overlap: Some(0.95 - b / far * 0.3),
                    status: if failed {
                        Status::Failed {
                            reason: "gaussians.ply: ends after 120 of 4000 vertices".into(),
                        }
                    } else {
                        Status::Ok
                    },
                    scores: if failed { BTreeMap::new() } else { scores },
                    extras: if *method == "depth-splat" {
                        BTreeMap::from([
                            ("mean_alpha".into(), 0.93 + 0.01 * r),
                            ("hole_share".into(), 0.07 - 0.01 * r),
                        ])
                    } else {
                        BTreeMap::new()
                    },
                });
            }
        }
    }
    let input = ReportInput {
        title: "Demo: Motorcycle and a procedural room".into(),
        summary: "Five methods predict one view from another on the bundled Middlebury pair and on a procedural multi-view scene; scored on 8-bit sRGB pictures at full resolution.".into(),
        records: &records,
        metrics: [MetricKey::DISTS, MetricKey::LPIPS, MetricKey::PSNR, MetricKey::SSIM].map(Metric::from).into(),
        extras: vec![Metric::reported("mean_alpha", "mean α", "", 3, "Mean opacity of the rendering."), Metric::reported("hole_share", "hole share", "", 3, "Share of pixels with opacity below one half.")],
        datasets: vec![], methods: methods.iter().map(|m| Method { label: (*m).into(), description: format!("The method {m}."), unranked: (*m == "target").then(|| "it is the target itself, a self-test".into()) }).collect(),
        facts: vec![FactGroup { title: "Protocol".into(), facts: vec![("pair list sha256".into(), "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08".into()), ("overlap".into(), "> 0.60 of the target's valid-depth pixels".into())] }],
        published: Published::Matching,
        pictures: &P { im },
        options: Options::default(),
    };
    let t = std::time::Instant::now();
    let files = write_report(&input, Path::new(&arg[1])).unwrap();
    for f in &files.all {
        println!("{} {}", f.display(), std::fs::metadata(f).unwrap().len());
    }
    println!("{}", text_tables(&input).unwrap());
    println!("{:?}", t.elapsed());
}
