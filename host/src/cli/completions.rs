//! `era completions` and `era man`: what a shell and `man` want to know of the command line.

use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_text_after_queued_log};
use clap::{Args, Command};
use clap_complete::Shell;
use era_files::{Readers, replace_file_by};
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, Args)]
pub struct Completions {
    /// The shell that the script is for
    #[arg(value_enum)]
    pub shell: Shell,
}

#[derive(Clone, Debug, Args)]
pub struct Man {
    /// Write the man pages of the program and of every command into this folder [default: print only the program's man
    /// page]
    #[arg(long, value_name = "DIR")]
    pub dir: Option<PathBuf>,
}

/// Prints a completion script for the whole command line.
pub fn print_completions(options: &Completions, mut command: Command) -> CommandResult {
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut command, name, &mut script);
    print_text_after_queued_log(String::from_utf8_lossy(&script).trim_end())
}

/// Prints or writes man pages of the whole command line.
pub fn print_or_write_man_pages(options: &Man, command: Command) -> CommandResult {
    let Some(folder) = &options.dir else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page).map_err(Failure::runtime_error)?;
        return print_text_after_queued_log(String::from_utf8_lossy(&page).trim_end());
    };
    let write = || {
        std::fs::create_dir_all(folder)?;
        let mut command = command.disable_help_subcommand(true);
        command.build();
        write_man_pages_of_command_and_subcommands(&command, folder)
    };
    write()
        .map_err(|error| Failure::runtime_error(format!("cannot write man pages to {}: {error}", folder.display())))?;
    tell!("the man pages are in {}; `man -l {}/era.1` shows the first page", folder.display(), folder.display());
    Ok(())
}

/// Writes the pages of a command and of those below it, each whole or not at all.
fn write_man_pages_of_command_and_subcommands(command: &Command, folder: &Path) -> std::io::Result<()> {
    for own in command.get_subcommands().filter(|own| !own.is_hide_set()) {
        write_man_pages_of_command_and_subcommands(own, folder)?;
    }
    let page = clap_mangen::Man::new(command.clone());
    replace_file_by(&folder.join(page.get_filename()), Readers::ByUmask, |mut file| page.render(&mut file))
}
