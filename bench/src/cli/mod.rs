//! The command line, one file per command.

mod analyze;
mod bundle;
mod cameras;
mod compare;
mod completions;
mod data_args;
mod datasets;
mod demo;
mod doctor;
mod explain;
mod figure;
mod gate;
mod help;
mod history;
mod man;
mod memory;
mod merge;
mod metrics;
mod model;
mod outcome;
mod output;
mod pairs;
mod protocols;
mod reading_args;
mod render;
mod report;
mod run;
mod scale;
mod schema;
mod score;
mod speed;
mod status;
mod sweep;
mod table;
mod train;
mod weights;

use std::borrow::Cow;
use std::ffi::OsString;

use clap::error::ErrorKind;
use clap::{FromArgMatches, Parser, Subcommand};

use crate::io::text::{one_line, shortened, visible, visible_line};
use model::{gaussians, parity, predict, record};
use outcome::{Outcome, UsageError, is_stopped, is_usage};

/// Evaluates single-photograph view synthesis the way the SHARP paper does.
#[derive(Debug, Parser)]
#[command(
    name = "sharp-bench",
    version,
    about,
    arg_required_else_help = true,
    after_help = "Exit codes: 0 success · 1 error · 2 wrong usage · 3 a gate fired · \
                  4 finished with recorded failures · 5 a gate cannot decide · \
                  75 stopped early, the same command continues\n\n\
                  Start with: sharp-bench demo"
)]
struct Cli {
    /// Show no progress; warnings, results and errors are still shown
    #[arg(long, short, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: CliCommand,
}

/// Defines the commands, in the order of the help. A command's module has its arguments and `execute`.
macro_rules! commands {
    ($($name:ident($module:ident::$args:ident),)+) => {
        #[derive(Debug, Subcommand)]
        enum CliCommand {
            $($name($module::$args),)+
        }

        impl CliCommand {
            fn execute(&self) -> anyhow::Result<Outcome> {
                match self {
                    $(Self::$name(args) => $module::execute(args),)+
                }
            }
        }
    };
}

commands! {
    Demo(demo::DemoArgs),
    Run(run::RunArgs),
    Score(score::ScoreArgs),
    Status(status::StatusArgs),
    Scale(scale::ScaleArgs),
    Merge(merge::MergeArgs),
    Report(report::ReportArgs),
    Table(table::TableArgs),
    Explain(explain::ExplainArgs),
    Speed(speed::SpeedArgs),
    Sweep(sweep::SweepArgs),
    Figure(figure::FigureArgs),
    Bundle(bundle::BundleArgs),
    Compare(compare::CompareArgs),
    Gate(gate::GateArgs),
    History(history::HistoryArgs),
    Pairs(pairs::PairsArgs),
    Protocols(protocols::ProtocolsArgs),
    Cameras(cameras::CamerasArgs),
    Datasets(datasets::DatasetsArgs),
    Metrics(metrics::MetricsArgs),
    Analyze(analyze::AnalyzeArgs),
    Train(train::TrainArgs),
    Predict(predict::PredictArgs),
    Render(render::RenderArgs),
    Gaussians(gaussians::GaussiansArgs),
    Record(record::RecordArgs),
    Parity(parity::ParityArgs),
    Weights(weights::WeightsArgs),
    Doctor(doctor::DoctorArgs),
    Schema(schema::SchemaArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

/// Runs a command line, whose first argument is the program's name. Returns the exit code; see
/// `sharp-bench --help`.
pub fn main(arguments: Vec<OsString>) -> u8 {
    let mut command = help::command();
    let matches = command.try_get_matches_from_mut(arguments);
    let parsed = matches.and_then(|matches| Cli::from_arg_matches(&matches));
    match parsed.map_err(|error| error.format(&mut command)) {
        Ok(cli) => match cli.execute() {
            Ok(outcome) => outcome.exit_code(),
            Err(error) => failed(&error),
        },
        Err(error) => {
            let text = error.render().to_string();
            // Report an invalid value on one line like any other error, whatever the value
            // contains.
            let hint = "\n\nFor more information, try '--help'.\n";
            if error.kind() == ErrorKind::ValueValidation
                && let Some(error) = text.strip_suffix(hint)
            {
                say(&format!("{}\n", visible_line(error)));
                return 2;
            }
            // The message quotes the command line, so escape control characters.
            match visible(&text) {
                // Nothing can be done if standard error is closed.
                Cow::Borrowed(_) => drop(error.print()),
                Cow::Owned(harmless) => say(&harmless),
            }
            u8::from(error.exit_code() != 0) * 2
        }
    }
}

/// Maximum length of a printed error, characters. Errors may quote a line, and a file may consist
/// of a single line.
const LONGEST_ERROR: usize = 4000;

fn failed(error: &anyhow::Error) -> u8 {
    let text = one_line(error);
    let (kind, code) = match (is_stopped(error), is_usage(error)) {
        (true, _) => ("stopped", Outcome::Resumable.exit_code()),
        (_, true) => ("error", 2),
        _ => ("error", 1),
    };
    say(&format!(
        "{kind}: {}\n",
        visible_line(&shortened(&text, LONGEST_ERROR))
    ));
    code
}

fn say(text: &str) {
    // Nothing can be done if standard error is closed.
    let _ = std::io::Write::write_all(&mut std::io::stderr(), text.as_bytes());
}

impl Cli {
    fn execute(self) -> anyhow::Result<Outcome> {
        if self.quiet {
            output::silence_progress();
        }
        self.command.execute()
    }
}

/// Maximum number of threads, more than any machine has. Starting more would take longer than the work itself.
const MAX_THREADS: usize = 4096;

/// Sizes the global thread pool; `None` uses all cores.
fn set_threads(threads: Option<usize>) -> anyhow::Result<()> {
    if let Some(threads) = threads {
        if !(1..=MAX_THREADS).contains(&threads) {
            let reason = format!("--threads {threads}: must be between 1 and {MAX_THREADS}");
            return Err(UsageError(reason).into());
        }
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()?;
    }
    Ok(())
}
