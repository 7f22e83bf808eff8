//! Two sizes of help: `--help` fits on a screen, `--help-all` is complete.

use clap::builder::StyledStr;
use clap::{Arg, ArgAction, Command, CommandFactory};

use super::Cli;

/// Special-purpose options, shown only by `--help-all`.
const RARE: [&str; 35] = [
    "adapter",
    "aggregate",
    "allow-programs",
    "allow-unused",
    "background",
    "cache",
    "color-space",
    "common-region",
    "depth-range",
    "device",
    "eps2d",
    "exact",
    "far",
    "fps",
    "keep-gaussians",
    "layer",
    "max-pixels",
    "memory-limit",
    "near",
    "no-cache",
    "overlap-checkpoint",
    "overlap-config",
    "overlap-depth",
    "plan",
    "plan-only",
    "quantise",
    "release-screen",
    "rendering",
    "scale-sweep",
    "shard",
    "simd",
    "stage",
    "time-budget",
    "warmup",
    "weights",
];

/// `--help` ends with the paragraphs that begin with one of these words; `--help-all` shows all paragraphs.
const ON_A_SCREEN: [&str; 2] = ["Example", "Start with"];

/// Commands on the first page; `--help-all` lists the others.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Evaluate", &["demo", "run", "score", "status", "merge"]),
    (
        "Compare",
        &["report", "compare", "gate", "history", "explain"],
    ),
    (
        "The paper",
        &["table", "figure", "sweep", "protocols", "analyze"],
    ),
    ("Data", &["datasets", "pairs", "metrics"]),
    ("Gaussians", &["predict", "render", "gaussians", "train"]),
    ("Tools", &["weights", "doctor"]),
];

/// The command line with `--help` and `--help-all`.
pub(super) fn command() -> Command {
    let command = two_sizes(Cli::command().disable_help_flag(true), "sharp-bench");
    let line = |sub: &Command| {
        let about = sub.get_about().map(ToString::to_string);
        format!("  {:<12} {}\n", sub.get_name(), about.unwrap_or_default())
    };
    let groups = GROUPS.map(|(title, names)| {
        let found = names
            .iter()
            .filter_map(|name| command.find_subcommand(name));
        format!("{title}:\n{}\n", found.map(line).collect::<String>())
    });
    let is_shown = |name: &str| GROUPS.iter().any(|(_, names)| names.contains(&name));
    let others = command.get_subcommands();
    let others: String = others
        .filter(|sub| !is_shown(sub.get_name()))
        .map(line)
        .collect();
    let names = command.get_subcommands().map(Command::get_name);
    let names: Vec<&str> = names.filter(|name| !is_shown(name)).collect();
    let more = format!("More commands: {}\nAll options:", names.join(", "));
    let on_a_screen = command.get_after_help().map(ToString::to_string);
    let on_a_screen = on_a_screen
        .unwrap_or_default()
        .replace("All options:", &more);
    let all = command.get_after_long_help().map(ToString::to_string);
    let all = format!("More commands:\n{others}\n{}", all.unwrap_or_default());
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}Options:\n{{options}}{{after-help}}",
        groups.concat()
    );
    let command = command.help_template(template);
    command.after_help(on_a_screen).after_long_help(all)
}

fn two_sizes(command: Command, path: &str) -> Command {
    let both = [
        Arg::new("help")
            .short('h')
            .long("help")
            .action(ArgAction::HelpShort)
            .help("This page"),
        Arg::new("help-all")
            .long("help-all")
            .action(ArgAction::HelpLong)
            .help("Every option in full"),
    ];
    let examples = command.get_after_help().map(ToString::to_string);
    let examples = examples.map(|text| examples_of(&text)).unwrap_or_default();
    let command = command.mut_args(negative).mut_args(short).args(both);
    let all = command.get_after_help().map(ToString::to_string);
    let command = command.after_long_help(unwrapped(&all.unwrap_or_default()));
    let more = format!("{examples}All options: {path} --help-all");
    command.after_help(more).mut_subcommands(|sub| {
        let path = format!("{path} {}", sub.get_name());
        two_sizes(sub, &path)
    })
}

/// Lets clap take negative numbers as option values, so that its error about such a value names the option.
fn negative(arg: Arg) -> Arg {
    let is_option = arg.get_long().is_some() && arg.get_action().takes_values();
    if is_option && !arg.is_allow_hyphen_values_set() {
        arg.allow_negative_numbers(true)
    } else {
        arg
    }
}

/// Shortens an option's help to its first clause and its default, and hides special-purpose options.
fn short(arg: Arg) -> Arg {
    let Some(help) = arg.get_help().map(ToString::to_string) else {
        return arg;
    };
    let full = arg.get_long_help().cloned();
    let full = full.unwrap_or_else(|| StyledStr::from(help.clone()));
    let (text, default) = split_default(&help);
    let ends = [". ", "; ", ": ", " ("].iter();
    let end = ends.filter_map(|end| text.find(end)).min();
    let clause = format!("{}{default}", &text[..end.unwrap_or(text.len())]);
    let is_rare = arg.get_long().is_some_and(|long| RARE.contains(&long));
    arg.help(clause).long_help(full).hide_short_help(is_rare)
}

/// Splits help into the text before ` [default: …]` and this default, which is empty if there is none.
fn split_default(help: &str) -> (&str, &str) {
    let Some(start) = help.find(" [default: ") else {
        return (help, "");
    };
    let (text, rest) = help.split_at(start);
    let end = rest.find(']').map_or(rest.len(), |bracket| bracket + 1);
    (text, &rest[..end])
}

/// Joins consecutive lines of prose, so that the terminal's width determines line breaks. Leaves indented lines, such
/// as examples, unchanged.
fn unwrapped(text: &str) -> String {
    let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ');
    let mut lines: Vec<String> = Vec::new();
    let mut follows_prose = false;
    for line in text.lines() {
        match lines.last_mut() {
            Some(before) if follows_prose && is_prose(line) => {
                before.push(' ');
                before.push_str(line);
            }
            _ => lines.push(line.to_owned()),
        }
        follows_prose = is_prose(line);
    }
    lines.join("\n")
}

/// The paragraph of examples for `--help`, followed by an empty line.
fn examples_of(text: &str) -> String {
    let lines = text
        .lines()
        .skip_while(|line| !ON_A_SCREEN.iter().any(|start| line.starts_with(start)));
    let lines: Vec<&str> = lines.take_while(|line| !line.is_empty()).collect();
    if lines.is_empty() {
        String::new()
    } else {
        lines.join("\n") + "\n\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines and columns of a screen of moderate size.
    const SCREEN: (usize, usize) = (50, 110);

    fn each(command: &mut Command, check: &mut dyn FnMut(&mut Command)) {
        check(command);
        command
            .get_subcommands_mut()
            .for_each(|sub| each(sub, check));
    }

    /// Two options with one id get each other's values; clap checks that only in debug builds.
    #[test]
    fn no_two_options_of_a_command_share_an_id() {
        let mut command = command();
        command.build();
        each(&mut command, &mut |command| {
            let mut ids: Vec<&str> = command
                .get_arguments()
                .map(|arg| arg.get_id().as_str())
                .collect();
            ids.sort_unstable();
            let twice = ids.windows(2).find(|two| two[0] == two[1]);
            assert_eq!(twice, None, "{}", command.get_name());
        });
    }

    #[test]
    fn help_is_a_screen_and_all_of_it_has_every_option() {
        let mut command = command().term_width(SCREEN.1);
        command.build();
        each(&mut command, &mut |command| {
            let (short, all) = (
                command.render_help().to_string(),
                command.render_long_help().to_string(),
            );
            let lines = short.lines().count();
            assert!(lines <= SCREEN.0, "{lines} lines:\n{short}");
            assert!(!all.contains("All options"), "{all}");
            let is_root = command.get_name() == "sharp-bench";
            if is_root {
                let subs = command.get_subcommands().map(Command::get_name);
                for sub in subs.filter(|sub| *sub != "help") {
                    assert!(all.contains(&format!("\n  {sub} ")), "{sub}:\n{all}");
                    assert!(short.contains(sub), "{sub}:\n{short}");
                }
            }
            assert_eq!(
                short.contains("Start with: sharp-bench demo"),
                is_root,
                "{short}"
            );
            for help in command.get_arguments().filter_map(Arg::get_help) {
                let help = help.to_string();
                assert!(!help.ends_with(','), "{help}");
            }
            for option in command.get_arguments().filter_map(Arg::get_long) {
                assert!(all.contains(&format!("--{option}")), "{option}:\n{all}");
            }
        });
    }

    #[test]
    fn short_help_is_the_first_clause_and_the_default() {
        for (help, expected) in [
            (
                "The other run; a bundle [default: A itself]. Read only",
                "The other run [default: A itself]",
            ),
            (
                "A dataset, [NAME:]FORMAT=PATH; repeatable",
                "A dataset, [NAME:]FORMAT=PATH",
            ),
        ] {
            let shortened = short(Arg::new("b").help(help));
            assert_eq!(shortened.get_help().unwrap().to_string(), expected);
        }
    }

    #[test]
    fn lines_of_prose_are_joined_and_examples_are_not() {
        let text = "Exit\ncode 1:\n  run \\\n      --out X\nWrites\nX.\n\nThe end";
        let joined = "Exit code 1:\n  run \\\n      --out X\nWrites X.\n\nThe end";
        assert_eq!(unwrapped(text), joined);
    }

    /// Longer lines would be wrapped without a backslash and could not be pasted into a shell.
    #[test]
    fn examples_fit_on_a_line() {
        each(&mut command(), &mut |command| {
            let all = command.get_after_long_help().map(ToString::to_string);
            let all = all.unwrap_or_default();
            let examples = all
                .lines()
                .filter(|line| line.starts_with("  sharp-bench "));
            for example in examples {
                assert!(example.chars().count() <= 100, "{example}");
            }
        });
    }

    #[test]
    fn commands_of_the_first_page_are_few_and_exist() {
        let command = command();
        let shown: Vec<&str> = GROUPS
            .iter()
            .flat_map(|(_, names)| *names)
            .copied()
            .collect();
        assert!(shown.len() <= 24);
        for name in shown {
            assert!(command.find_subcommand(name).is_some(), "{name}");
        }
    }

    #[test]
    fn every_rare_option_exists() {
        let mut found = std::collections::BTreeSet::new();
        each(&mut command(), &mut |command| {
            let options = command.get_arguments().filter_map(Arg::get_long);
            found.extend(options.map(str::to_owned));
        });
        let gone: Vec<_> = RARE.iter().filter(|rare| !found.contains(**rare)).collect();
        assert_eq!(gone, Vec::<&&str>::new());
    }
}
