//! Writes manual pages and shell completions, from the same definitions as `--help`, for a package to hold.
//!
//! `cargo run -p lantern --example pages -- FOLDER`: `FOLDER/man`, `FOLDER/bash`, `FOLDER/zsh` and `FOLDER/fish`.

use std::fs;
use std::path::PathBuf;

use anyhow::Context;
use clap::{Command, CommandFactory};
use clap_complete::Shell;

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os().nth(1).map(PathBuf::from).context("usage: pages FOLDER")?;
    for program in [lantern::program::args::Arguments::command(), lantern::ctl::command()] {
        pages(program.clone(), folder.join("man"))?;
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let folder = folder.join(shell.to_string());
            fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
            let name = program.get_name().to_owned();
            clap_complete::generate_to(shell, &mut program.clone(), name, &folder)
                .with_context(|| format!("writing completions for {shell}"))?;
        }
    }
    Ok(())
}

/// A page for the program and one for each of its subcommands.
fn pages(program: Command, folder: PathBuf) -> anyhow::Result<()> {
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    clap_mangen::generate_to(program, &folder).with_context(|| format!("writing pages to {}", folder.display()))
}
