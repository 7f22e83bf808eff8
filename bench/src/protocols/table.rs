//! The presets. The facts are from reading the original code at the stated commits; no code is
//! copied.

use super::{Border, PairMask, PairRule, Protocol, Quantised};
use crate::evaluate::Aggregation;

const EVERY_8TH: &str =
    "of the images sorted by name, those with index % 8 == 0 are tested, each made from all others";
const RE10K_INDEX: &str =
    "an evaluation index (JSON), of which one context view becomes the source";
const OUR_CAMERAS: &str = "cameras: the principal point follows the crop; the original's stays in the middle, off by half a \
    pixel where an odd number of columns is cut";
const CUDA_MESSAGE: &str =
    "missing scenes and frames are skipped silently, exceptions drop their batch into a CSV";

const PLAIN: Protocol = Protocol {
    name: "",
    source: "",
    pairs: PairRule::Paper,
    frame: None,
    alpha: None,
    border: Border::Kept,
    quantised: Quantised::Round,
    metrics: &[],
    aggregation: Aggregation::Pairs,
    mask: PairMask::NotExcluded,
    failures: "raises",
    traps: &[],
    departures: &[],
};

const PIXELSPLAT: Protocol = Protocol {
    name: "pixelsplat",
    source: "dcharatan/pixelsplat 32b1b662bbba8c6a2b598433e4872f0d36639e43",
    pairs: PairRule::List(RE10K_INDEX),
    frame: Some("cover:256x256:lanczos"),
    quantised: Quantised::Truncate,
    metrics: &["psnr", "ssim[gauss11,valid,sample]", "lpips[vgg,v0.1]"],
    aggregation: Aggregation::Scenes,
    failures: "prints a message and skips a scene if one of its files is missing for any compared method",
    traps: &[
        "583 of the 19422 pairs of the RealEstate10K index predict a context view itself",
        "predictions are truncated to 8 bit, half a level darker on average than rounded ones",
        "scenes wider than 100 degrees, of another shape than 3x360x640 or with a baseline below 1e-3 are not evaluated",
    ],
    departures: &[
        "pairs: one context view is the source; the original sees two",
        OUR_CAMERAS,
        "scenes: nothing is skipped by field of view, shape or baseline",
    ],
    ..PLAIN
};

const MVSPLAT: Protocol = Protocol {
    name: "mvsplat",
    source: "donydchen/mvsplat 175b17a636a081455c46b309eccacedd626a7d59",
    quantised: Quantised::Float,
    failures: "skips scenes as pixelSplat does; an index that is missing crashes",
    traps: &[
        "583 of the 19422 pairs of the RealEstate10K index predict a context view itself",
        "scenes wider than 100 degrees or of another shape than 3x360x640 are not evaluated",
    ],
    departures: &[
        "pairs: one context view is the source; the original sees two or three",
        OUR_CAMERAS,
        "scenes: nothing is skipped by field of view or shape",
    ],
    ..PIXELSPLAT
};

/// All presets; see [`Protocol::named`].
pub const PROTOCOLS: [Protocol; 15] = [
    Protocol {
        name: "sharp",
        source: "the SHARP paper; what it leaves open is an option (`pairs --help-all`)",
        metrics: &["dists", "lpips[alex,v0.1]", "psnr", "ssim[gauss11,valid]"],
        failures: "not stated",
        departures: &[
            "metrics: the paper states neither the network of LPIPS nor the window of SSIM",
        ],
        ..PLAIN
    },
    Protocol {
        name: "unisharp",
        source: "Insta360-Research-Team/UniSHARP 5263322553d3e6eff405976dc900bc5de36b7ba8",
        pairs: PairRule::List(
            "a manifest (fields separated by |) with a source and its targets on each line",
        ),
        quantised: Quantised::Float,
        metrics: &[
            "psnr[floor=1e-8]@mask",
            "ssim[gauss11,zero,eps=1e-8]@mask",
            "lpips[alex,v0.1,box-paste]@mask",
        ],
        aggregation: Aggregation::Sources,
        mask: PairMask::SourceBounds,
        failures: CUDA_MESSAGE,
        traps: &[
            "PSNR is at most 80 dB, so that identical pictures count as 80",
            "the 1e-8 in SSIM's denominator lowers its values in black areas by a tenth, even where both pictures are equal",
            "LPIPS of the pasted box counts the pasted pixels as agreement: a small mask in a large box scores nearly perfectly",
            "manifest lines with another field count are silently dropped and still use up a group number",
            "the launcher skips LPIPS by default, and without the LPIPS package the column contains L1",
        ],
        departures: &[
            "mask: no number without the target's depth; the original falls back to cached masks, then to predicted depth, \
             then to no mask",
            "renderings: blended over black; the original divides them by alpha before sRGB encoding",
            "aggregation: by source view; the original averages by manifest line, which is the same unless two lines share a source",
            "datasets: the original takes images_4 of Tanks and Temples and DL3DV, and separate masks for panoramas and fisheyes",
        ],
        ..PLAIN
    },
    PIXELSPLAT,
    MVSPLAT,
    Protocol {
        name: "depthsplat",
        source: "cvg/depthsplat 2dad25a7b9ba7c5537aba08463ef88d8511a06be",
        ..MVSPLAT
    },
    Protocol {
        name: "lvsm",
        source: "Haian-Jin/LVSM 2fea9242a941072c6263b96eb1b52f2a80503ce3",
        frame: Some("cover8:256x256:lanczos"),
        failures: "scenes without a metrics file are skipped; a distributed sampler drops or repeats scenes",
        traps: &[
            "583 of the 19422 pairs of the RealEstate10K index predict a context view itself",
            "the width after resizing is rounded to a multiple of 8, so the pixels differ from pixelSplat's: 640x360 \
             becomes 456x256, and the crop starts at column 100",
        ],
        departures: &[
            "LPIPS: in f32; the original computes it inside bfloat16 autocast, which differs in the third decimal and is refused here",
            "pairs: one context view is the source; the original sees two",
        ],
        ..MVSPLAT
    },
    Protocol {
        name: "seva",
        source: "Stability-AI/stable-virtual-camera fe19948e9b7bea261ab2db780a59656131404a83",
        pairs: PairRule::List("a split (JSON with train_ids and test_ids) beside transforms.json"),
        frame: Some("cover:576x576:area"),
        quantised: Quantised::Unpublished,
        metrics: &[
            "psnr",
            "ssim[gauss11,valid]",
            "ssim[gauss11,reflect]",
            "lpips[alex,v0.1,eps=tm]",
        ],
        failures: "not published",
        traps: &[
            "inputs of one view are rendered at 20 scales of the scene; which of them is scored is not published",
            "the metrics are those that its authors name in issue 53 of their repository, torchmetrics' with data_range=1 and \
             LPIPS on -1..1; the version is not named: SSIM is one of the two columns, valid before 1.4.2, reflect since",
        ],
        departures: &[
            "aggregation: none is published; this harness's own is used",
            "resize: OpenCV's INTER_AREA; the original uses torch's `area`, means over whole pixels",
            "size: 576x576; the original's RealEstate10K outputs are reduced to 256 afterwards, and ViewCrafter's splits are \
             cropped differently",
        ],
        ..PLAIN
    },
    Protocol {
        name: "flash3d",
        source: "eldar/flash3d a71c9b92b07a76cf944f2ed894f384f0891a1960",
        pairs: PairRule::List(
            "a split (text): key, source and three target slots per line; one slot at a time",
        ),
        frame: Some("stretch:384x256:lanczos"),
        border: Border::Twentieth,
        quantised: Quantised::Float,
        metrics: &[
            "psnr",
            "ssim[gauss11,valid]",
            "ssim[gauss11,reflect]",
            "lpips[vgg,v0.1,eps=tm]",
        ],
        traps: &[
            "the printed mean is over source, +5, +10 and random slots: the source view itself counts a quarter",
            "the version of torchmetrics is not pinned: SSIM is one of the two columns, valid before 1.4.2, reflect since",
            "pictures are stretched to 3:2, so that PSNR weighs both axes differently",
        ],
        departures: &[
            "scale: the original scales translations by fitting predicted to COLMAP depth with unseeded RANSAC; here cameras \
             are the dataset's",
            "PSNR: the original does not clip; pictures here lie in 0..1",
            "size: 384x256 as for RealEstate10K; the original's KITTI is 384x128, with an unrecorded border",
        ],
        ..PLAIN
    },
    Protocol {
        name: "splatter",
        source: "szymanowiczs/splatter-image 98b465731c3273bf8f42a747d1b6ce1a93faf3d6",
        pairs: PairRule::Refused(
            "SRN and CO3D have no reader here (source view 64 of 251, or the first; all other views are targets, all-black \
             ones left out; 128x128; psnr, ssim[gauss11,zero], lpips[vgg,v0.1]; means of objects)",
        ),
        quantised: Quantised::Float,
        metrics: &["psnr", "ssim[gauss11,zero]", "lpips[vgg,v0.1]"],
        aggregation: Aggregation::Scenes,
        ..PLAIN
    },
    Protocol {
        name: "3dgs",
        source: "graphdeco-inria/gaussian-splatting 15d64e67814605c4d5b24a326aad29da74898acc",
        pairs: PairRule::NoSource(EVERY_8TH),
        frame: Some("width:1600:bicubic"),
        alpha: Some("white"),
        metrics: &["psnr", "ssim[gauss11,zero]", "lpips[vgg,v0.1,unscaled]"],
        failures: "raises an exception; reduced-3dgs continues with the next scene",
        traps: &[
            "LPIPS gets pictures in 0..1 although its network expects -1..1, so values are lower than elsewhere",
            "zero padding makes the borders of both pictures more alike for SSIM",
        ],
        departures: &[
            "size: of the pictures given; the original takes images_4 outdoors and images_2 indoors",
            "aggregation: over all images of a dataset; the original's is per scene, and the paper's means are over scenes",
        ],
        ..PLAIN
    },
    Protocol {
        name: "splatfacto",
        source: "nerfstudio-project/nerfstudio 50e0e3c70c775e89333256213363badbf074f29d",
        pairs: PairRule::NoSource(
            "the nerfstudio parser tests the images left over by an evenly spaced choice of 90 %, the COLMAP parser those with index % 8 == 0",
        ),
        quantised: Quantised::Float,
        metrics: &["psnr", "ssim[gauss11,valid]", "lpips[alex,v0.1,eps=tm]"],
        departures: &[
            "size: as given here; the original halves the pictures until no side exceeds 1600, reading reduced copies made by other \
             programs",
        ],
        ..PLAIN
    },
    Protocol {
        name: "nerfacto",
        source: "nerfstudio-project/nerfstudio 50e0e3c70c775e89333256213363badbf074f29d",
        pairs: PairRule::NoSource(
            "the nerfstudio parser tests the images left over by an evenly spaced choice of 90 %, the COLMAP parser those with index % 8 == 0",
        ),
        quantised: Quantised::Float,
        metrics: &[
            "psnr",
            "ssim[gauss11,reflect,range=data]",
            "ssim[gauss11,valid,range=data]",
            "lpips[alex,v0.1,eps=tm]",
        ],
        traps: &[
            "SSIM's data range is that of the pictures: low-contrast ones score lower, and two black ones have no score",
            "the version of torchmetrics is not pinned: SSIM is one of the two columns, valid before 1.4.2, reflect since",
            "surface models pass pictures in 0..1 to LPIPS (lpips[alex,v0.1,unscaled])",
        ],
        departures: &[
            "size: as given here; the original halves the pictures until no side exceeds 1600, reading reduced copies made by other \
             programs",
        ],
        ..PLAIN
    },
    Protocol {
        name: "nerfbaselines",
        source: "nerfbaselines/nerfbaselines cde53bda36e65985ca15c79957725a9054fb55b4",
        pairs: PairRule::NoSource(EVERY_8TH),
        alpha: Some("white"),
        quantised: Quantised::Truncate,
        metrics: &[
            "psnr",
            "ssim[gauss11,valid,cov=bounded]",
            "lpips[alex,v0.1]",
            "lpips[vgg,v0.1]",
        ],
        traps: &[
            "both pictures are truncated to 8 bit; the truth, which is 8 bit already, does not change",
        ],
        departures: &[
            "mask: excluded pixels do not count; the original multiplies both pictures by the mask, so that excluded pixels \
             count as equal and black, which raises PSNR",
            "LPIPS: both networks; the original adds vgg for mip-NeRF 360 only",
            "size: of the pictures given; the original has a factor for each scene",
        ],
        ..PLAIN
    },
    Protocol {
        name: "multinerf",
        source: "google-research/multinerf 5b4d4f64608ec8077222c52fdf814d40acc10bc1",
        pairs: PairRule::NoSource(EVERY_8TH),
        alpha: Some("white"),
        metrics: &["psnr", "ssim[gauss11,valid,cov=bounded]"],
        failures: "not handled",
        departures: &[
            "colour: no second set of numbers after the original's quadratic colour correction of each picture",
            "LPIPS: the original does not publish the code",
        ],
        ..PLAIN
    },
    Protocol {
        name: "scannetpp",
        source: "scannetpp/scannetpp f3b4712697184fe0b83ab28d273b85e5f011361a",
        pairs: PairRule::NoSource(
            "test_frames of dslr/nerfstudio/transforms.json, each made from all training frames",
        ),
        metrics: &[
            "psnr@mask",
            "ssim[gauss11,valid,mask=window]@mask",
            "lpips[vgg,v0.1,layer-mask]@mask",
        ],
        failures: "a missing picture or mask ends the evaluation",
        traps: &[
            "a scene with many test images counts more: the mean is over all images of all scenes",
            "LPIPS has a mean of its own at each layer, over what no excluded pixel reaches: deep layers weigh only what is far from \
             excluded pixels",
        ],
        departures: &[
            "pictures: undistorted to a pinhole camera, with their masks; the original takes the fisheye pictures as stored",
            "size: predictions of another size need `resize=bicubic`; the original resizes them without asking",
        ],
        ..PLAIN
    },
];
