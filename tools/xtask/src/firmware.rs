//! `cargo xtask firmware`: builds the image, says how big it is, and compares that with its budget.

use crate::budget::{self, Budget, BudgetRow};
use crate::error::Error;
use crate::image::build_image_and_return_target_source;
use crate::process::has_python_with_venv;
use crate::target::TARGET;
use crate::{elf, repository_root, stack};
use std::fs;
use std::path::Path;

/// Options of `cargo xtask firmware`.
#[derive(Debug, Default, clap::Args)]
pub struct Options {
    /// Build core and alloc from Debian's rust-src even if rustup has the target.
    #[arg(long)]
    build_std: bool,
    /// Print only the path of the image, for scripts.
    #[arg(long)]
    print_path: bool,
    /// Compare flash, RAM and worst-case stack with firmware/budget.toml, and fail over it.
    #[arg(long)]
    budget: bool,
    /// With --budget: show the chains of calls that take the most stack.
    #[arg(long, requires = "budget")]
    chains: bool,
}

/// Builds and reports.
///
/// # Errors
/// What went wrong in getting the target, building, or reading the image.
pub fn build_image_and_print_path_or_memory_usage_and_budget(options: &Options) -> Result<(), Error> {
    let (image, way) = build_image_and_return_target_source(options.build_std)?;
    if options.print_path {
        println!("{}", image.display());
        return Ok(());
    }
    let usage = elf::read_memory_usage(&image)?;
    println!("target  {TARGET} ({})", way.describe());
    println!(
        "flash   {:>7} of {:>7} bytes ({:.1} %)",
        usage.flash,
        usage.flash_total,
        compute_percent(usage.flash, usage.flash_total)
    );
    println!(
        "RAM     {:>7} of {:>7} bytes ({:.1} %), the rest is stack",
        usage.ram,
        usage.ram_total,
        compute_percent(usage.ram, usage.ram_total)
    );
    println!("image   {}", image.display());
    if options.budget {
        check_isb_and_print_and_check_memory_and_stack_against_budget(&image, &usage, options.chains)
    } else {
        Ok(())
    }
}

/// Prints the image's use of the chip against its budget.
fn check_isb_and_print_and_check_memory_and_stack_against_budget(
    image: &Path,
    usage: &elf::MemoryUsage,
    shows_chains: bool,
) -> Result<(), Error> {
    let budget = Budget::read(&repository_root()?)?;
    let data =
        fs::read(image).map_err(|source| Error::File { what: "cannot read", path: image.to_path_buf(), source })?;
    let rules = stack::Rules {
        executors: &budget.stack.executors,
        recursion: budget.stack.recursion,
        priorities: &budget.stack.priorities,
    };
    let unbounded = |source| Error::Stack { path: image.to_path_buf(), source };
    let program = stack::Program::read(&data).map_err(unbounded)?;
    check_that_isb_follows_each_sleep(image, &program)?;
    let levels = stack::find_deepest_call_chain_of_each_nesting_level(&program, &rules).map_err(unbounded)?;
    println!("stack, at most, each level on top of the one before:");
    for level in &levels {
        println!("  {:>7} bytes  {}", level.bytes, level.name);
        for (function, bytes) in level.chain.iter().filter(|_| shows_chains) {
            println!("    {bytes:>7}  {function}");
        }
    }
    let stack: u32 = levels.iter().map(|level| level.bytes).sum();
    if has_python_with_venv() {
        let seen = stack::check_interrupt_priorities_and_measure_most_stack_bytes_in_use(
            image,
            &program,
            &budget.stack.priorities,
        )?;
        println!("stack, seen in use on the emulated board: {seen} bytes");
        if seen > stack {
            return Err(unbounded(stack::StackError::BeyondBound { seen, bound: stack }));
        }
    } else {
        println!("skipped: stack in use on the emulated board (python3 with venv is not installed)");
    }
    budget::print_and_check_rows(&[
        BudgetRow::in_bytes("flash", usage.flash, budget.flash.bytes),
        BudgetRow::in_bytes("RAM", usage.ram, budget.ram.bytes),
        BudgetRow::in_bytes("stack", stack, budget.stack.bytes),
    ])
}

/// The errata sheet's way around a wrong first fetch after a sleep.
fn check_that_isb_follows_each_sleep(image: &Path, program: &stack::Program) -> Result<(), Error> {
    let wrong: Vec<&str> =
        program.sleeps.iter().filter(|(_, has_isb)| !has_isb).map(|(function, _)| function.as_str()).collect();
    let reason = match (program.sleeps.len(), &wrong[..]) {
        (0, _) => "the image has no WFI, so that nothing was checked".to_owned(),
        (_, []) => {
            println!("an ISB follows each WFI ({})", program.sleeps.len());
            return Ok(());
        }
        (_, wrong) => format!("no ISB follows the WFI in {}", wrong.join("; ")),
    };
    Err(Error::Image { path: image.to_path_buf(), reason })
}

fn compute_percent(part: u32, whole: u32) -> f64 {
    100.0 * f64::from(part) / f64::from(whole)
}
