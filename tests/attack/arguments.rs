//! Options with unintended values.

use std::sync::LazyLock;

use sharp_tests::words;

use super::case::{Case, Verdict};

/// Option, value, and whether a run with them must have the same scores as a run without.
const OPTIONS: [(&str, &str, bool); 45] = [
    ("--limit", "0", false),
    ("--limit", "-1", false),
    ("--limit", "18446744073709551616", false),
    ("--limit", "1e3", false),
    ("--limit", "1000000000", true),
    ("--threads", "0", false),
    ("--threads", "1000000000", false),
    ("--threads", "64", true),
    ("--memory-limit", "0", true),
    ("--memory-limit", "-1G", false),
    ("--memory-limit", "99999999T", false),
    ("--metrics", "", false),
    ("--metrics", ",,,", false),
    ("--metrics", "psnr,psnr", true),
    ("--metrics", "ssim[gauss11", false),
    ("--metrics", "../../etc/passwd", false),
    ("--pair-options", "threshold=nan", false),
    ("--pair-options", "threshold=-1", false),
    ("--pair-options", "size=1", false),
    ("--pair-options", "size=99999999999999999999", false),
    ("--pair-options", "stride=0", false),
    ("--pair-options", "test=consistent:inf", false),
    ("--pair-options", "=,=", false),
    ("--pair-options", "seed=\u{202e}1", false),
    ("--scenes", "[", false),
    ("--scenes", "\u{1b}[2J", false),
    ("--scenes", "**", true),
    ("--dataset", "S2:synthetic=size=0x0", false),
    ("--dataset", "S2:synthetic=size=60000x60000,views=2", false),
    ("--dataset", "S2:synthetic=views=0", false),
    ("--dataset", "S2:synthetic=views=99999999999", false),
    ("--dataset", "S2:synthetic=size=nan", false),
    ("--dataset", "S:synthetic", false),
    ("--dataset", "=x", false),
    ("--dataset", "colmap=/dev/null", false),
    ("--dataset", "colmap=/proc/self", false),
    ("--method", "copy:label=../../x", false),
    ("--method", "copy:label=\u{1b}[31m", false),
    ("--method", "imported:dir=/dev/null", false),
    ("--method", "imported:dir=.,crop=1:2:3", false),
    ("--method", "command:run='true',timeout=inf", false),
    ("--method", "gaussians:dir=.,color_space=\u{2066}", false),
    ("--backend", "quantum", false),
    ("--simd", "avx9000", false),
    ("--pairs", "/dev/zero", false),
];

const RUN: &str = "run --dataset S:synthetic=size=32x24,views=4 --no-cache --method";

static SCORES: LazyLock<Result<String, String>> = LazyLock::new(|| {
    let mut case = Case::new("plain", 0);
    let said = case.run(&[words(RUN), words("copy --metrics psnr --out r")].concat())?;
    match said.code {
        0 => Ok(case.read("r/scores.csv")),
        _ => Err(said.err),
    }
});

pub(crate) fn options(case: &mut Case) -> Result<Verdict, String> {
    let (option, value, is_harmless) = *case.random.pick(&OPTIONS);
    // A message must name the option, its value, or the wrong part of the value.
    case.note(
        format!("{option} {value:?}"),
        option.trim_start_matches('-'),
    );
    for part in value
        .split([':', '=', ','])
        .filter(|part| !part.trim().is_empty())
    {
        case.may_name(part);
    }
    for word in ["label", "metric", "S2", "scene", "dataset"] {
        case.may_name(word);
    }
    let mut args = [words(RUN), words("copy --out r")].concat();
    if option != "--metrics" {
        args.extend(["--metrics", "psnr"]);
    }
    args.extend([option, value]);
    let said = case.run(&args)?;
    match (said.code, is_harmless) {
        (0, true) if case.read("r/scores.csv") == *SCORES.as_ref().map_err(Clone::clone)? => {
            Ok(Verdict::Number)
        }
        (0, true) => Err("other scores".to_owned()),
        (0, false) => Err(format!("accepted: {}", said.out)),
        (_, true) => Err(format!("refused: {}", said.err)),
        (_, false) => Ok(Verdict::Error),
    }
}
