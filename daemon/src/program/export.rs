//! `lanternd export`: a projector's calibration as a file for others.

use std::path::Path;

use anyhow::{Context, bail};
use lantern_calibration::{Calibration, export};
use lantern_config::Config;

use crate::service::setup::Problems;

/// What can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A [projector.calibration] to paste into a configuration.
    Matrices,
    /// A VESA MPCDI archive.
    Mpcdi,
}

/// Writes the calibration of a projector as the configuration has it now, and says what the file does not hold.
///
/// # Errors
/// A bad configuration or calibration, an unknown projector, or a file that cannot be written.
pub fn export(config: &Path, projector: &str, format: Format, output: &Path) -> anyhow::Result<()> {
    let config = Config::load(config).map_err(Problems)?;
    let Some(configured) = config.projectors.iter().find(|p| p.name == projector) else {
        let names: Vec<_> = config.projectors.iter().map(|p| p.name.as_str()).collect();
        bail!("there is no projector `{projector}`; hint: there are {}", names.join(", "));
    };
    let calibration = Calibration::from_config(configured)?;
    let exported = match format {
        Format::Matrices => export::matrices(&calibration),
        Format::Mpcdi => export::mpcdi(&calibration, projector)?,
    };
    std::fs::write(output, &exported.bytes).with_context(|| format!("writing {}", output.display()))?;
    say!("{}", output.display());
    for left_out in &exported.left_out {
        eprintln!("not in it: {left_out}");
    }
    Ok(())
}
