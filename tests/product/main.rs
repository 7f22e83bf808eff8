//! Tests of the whole product as users run it: the binary, its files, its exit codes.

#[cfg(test)]
mod analyze_command;
#[cfg(test)]
#[cfg(unix)]
mod cases;
#[cfg(test)]
mod compare_command;
#[cfg(test)]
mod datasets_command;
#[cfg(test)]
mod demo_command;
#[cfg(test)]
#[cfg(unix)]
mod example_repository;
#[cfg(test)]
mod excluded_pixels;
#[cfg(test)]
mod foreign_methods;
#[cfg(test)]
mod gate_command;
#[cfg(test)]
mod history_command;
#[cfg(test)]
mod hostile_folders;
#[cfg(test)]
mod incomplete_datasets;
#[cfg(test)]
mod metric_devices;
#[cfg(test)]
mod metrics_command;
#[cfg(test)]
mod metrics_options;
#[cfg(test)]
mod model_commands;
#[cfg(test)]
mod own_pictures;
#[cfg(test)]
mod pairs_command;
#[cfg(test)]
mod photographs;
#[cfg(test)]
mod ports;
#[cfg(test)]
mod protocols_command;
#[cfg(test)]
mod render_command;
#[cfg(test)]
mod render_scene;
#[cfg(test)]
mod run_command;
#[cfg(test)]
mod speed_command;
#[cfg(test)]
mod support;
#[cfg(test)]
mod sweep_command;
#[cfg(test)]
mod table_command;
#[cfg(test)]
mod tiny;
#[cfg(test)]
mod traced_models;
#[cfg(test)]
mod train_command;
#[cfg(test)]
mod weights_command;
