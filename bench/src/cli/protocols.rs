//! `protocols`: published evaluations by name.

use clap::Args;

use super::outcome::UsageError;
use super::{Outcome, output};
use crate::protocols::{PROTOCOLS, PairRule, Protocol};

/// List published evaluation protocols, or show one
///
/// `run --protocol NAME` adopts the protocol's metrics, picture sizes, masks, rounding and averages. The report
/// states where sharp-bench differs.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench protocols
  sharp-bench protocols pixelsplat
  sharp-bench run --protocol unisharp --pairs theirs.csv --dataset wildrgbd=data --method copy --out runs/theirs")]
pub(super) struct ProtocolsArgs {
    /// A protocol to show in full
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &ProtocolsArgs) -> anyhow::Result<Outcome> {
    let Some(name) = &args.name else {
        if args.json {
            output::json(&*PROTOCOLS)?;
            return Ok(Outcome::Done);
        }
        for protocol in PROTOCOLS.iter() {
            let name = &protocol.name;
            output::line(format!("{name:<14} {}", summary(protocol)))?;
        }
        return Ok(Outcome::Done);
    };
    let protocol = Protocol::named(name).map_err(|error| UsageError(error.to_string()))?;
    if args.json {
        output::json(protocol)?;
        return Ok(Outcome::Done);
    }
    let pairs = match &protocol.pairs {
        PairRule::Paper => "built as the SHARP paper says".to_owned(),
        PairRule::List(what) => format!("{what}; --pairs FILE"),
        PairRule::NoSource(rule) => format!("no source view ({rule}); --pairs FILE"),
        PairRule::Refused(reason) => format!("refused: {reason}"),
    };
    for (what, text) in [
        ("protocol", protocol.name.clone()),
        ("source", protocol.source.clone()),
        ("pairs", pairs),
        (
            "size",
            protocol
                .frame
                .as_deref()
                .unwrap_or("as the dataset has it")
                .to_owned(),
        ),
        (
            "alpha",
            protocol.alpha.as_ref().map_or_else(
                || "refused".to_owned(),
                |rule| format!("composited over {rule}"),
            ),
        ),
        ("border", protocol.border.to_string()),
        ("metrics", metrics(protocol)),
        ("means", protocol.aggregation.to_string()),
        ("mask", protocol.mask.to_string()),
        ("failures", protocol.failures.clone()),
    ] {
        output::line(format!("{what:<14} {text}"))?;
    }
    for trap in &protocol.traps {
        output::line(format!("{:<14} {trap}", "kept as it is"))?;
    }
    for departure in protocol.departures() {
        output::line(format!("{:<14} {departure}", "differs here"))?;
    }
    Ok(Outcome::Done)
}

fn metrics(protocol: &Protocol) -> String {
    match protocol.metrics.as_slice() {
        [] => "none published".to_owned(),
        keys => keys.join(" "),
    }
}

fn summary(protocol: &Protocol) -> String {
    let size = protocol.frame.as_deref().unwrap_or("native");
    match protocol.pairs {
        PairRule::Refused(_) => "refused; `protocols NAME` says why".to_owned(),
        _ => format!("{size}; {}; {}", metrics(protocol), protocol.aggregation),
    }
}
