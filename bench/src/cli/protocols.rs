//! `protocols`: published evaluations by name.

use std::fmt::{self, Display, Formatter};

use clap::Args;

use super::outcome::UsageError;
use super::{Outcome, output};
use crate::protocols::{PROTOCOLS, PairRule, Protocol};

/// List published evaluation protocols, or show one
///
/// `run --protocol NAME` adopts the protocol's metrics, picture sizes, masks, rounding and averages. The report states
/// where sharp-bench differs from the original evaluation.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench protocols
  sharp-bench protocols pixelsplat
  sharp-bench run --protocol unisharp --pairs theirs.csv --dataset wildrgbd=data --method copy \\
      --out runs/theirs")]
pub(super) struct ProtocolsArgs {
    /// A protocol to show in full
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &ProtocolsArgs) -> anyhow::Result<Outcome> {
    match &args.name {
        None => output::print(args.json, || PROTOCOLS.as_slice(), list)?,
        Some(name) => {
            let protocol = Protocol::named(name).map_err(|error| UsageError(error.to_string()))?;
            output::print(args.json, || protocol, || protocol.to_string())?;
        }
    }
    Ok(Outcome::Done)
}

fn list() -> String {
    let line = |protocol: &Protocol| format!("{:<14} {}\n", protocol.name, summary(protocol));
    PROTOCOLS.iter().map(line).collect()
}

impl Display for Protocol {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let pairs = match &self.pairs {
            PairRule::Paper => "built as the SHARP paper states".to_owned(),
            PairRule::List(what) => format!("{what}; give it with --pairs FILE"),
            PairRule::NoSource(rule) => format!(
                "no source view ({rule}); state a source for each target in a list, and give it with --pairs FILE"
            ),
            PairRule::Refused(reason) => format!("refused: {reason}"),
        };
        for (what, text) in [
            ("protocol", self.name.clone()),
            ("source", self.source.clone()),
            ("pairs", pairs),
            (
                "size",
                self.frame
                    .as_deref()
                    .unwrap_or("as the dataset has it")
                    .to_owned(),
            ),
            (
                "alpha",
                self.alpha.as_ref().map_or_else(
                    || "refused".to_owned(),
                    |rule| format!("composited over {rule}"),
                ),
            ),
            ("border", self.border.to_string()),
            ("metrics", metrics(self)),
            ("means", self.aggregation.to_string()),
            ("mask", self.mask.to_string()),
            ("failures", self.failures.clone()),
        ] {
            writeln!(f, "{what:<14} {text}")?;
        }
        for trap in &self.traps {
            writeln!(f, "{:<14} {trap}", "kept as it is")?;
        }
        for departure in self.departures() {
            writeln!(f, "{:<14} {departure}", "differs here")?;
        }
        Ok(())
    }
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
