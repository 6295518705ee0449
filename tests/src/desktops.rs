//! Desktops without a screen, and what they show: an X11 server and a Wayland compositor, each with a program of its own project that
//! takes pictures of it.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use ::image::{ImageFormat, RgbImage};
use anyhow::{Context, Result, bail, ensure};
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

/// No desktop on this machine takes longer to come up, or to show what it was given, even beside other tests.
const LIMIT: Duration = Duration::from_secs(30);

/// Says where programs come from that are not there.
const HINT: &str = "hint: packaging/test installs xvfb, x11-apps, netpbm and weston";

/// A server that ends with this.
struct Server(Child);

impl Server {
    fn kill(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }

    fn signal(&self, signal: Signal) -> Result<()> {
        kill_process(Pid::from_child(&self.0), signal).context("sending a desktop a signal")
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}

/// What all of them do.
pub trait Desktop {
    /// How an output names it.
    fn server(&self) -> String;

    /// What it shows, all of it.
    ///
    /// # Errors
    /// Where the program that takes the picture is not there, or fails.
    fn grab(&self) -> Result<RgbImage>;

    /// Ends it at once, as a crash would.
    fn crash(&mut self);

    /// Sends its server a signal.
    ///
    /// # Errors
    /// Where it has gone.
    fn signal(&self, signal: Signal) -> Result<()>;

    /// Waits until it shows just this.
    ///
    /// # Errors
    /// Where it does not in time; with how many pixels differ.
    fn shows(&self, picture: &RgbImage) -> Result<()> {
        let started = Instant::now();
        loop {
            let grabbed = self.grab()?;
            if grabbed == *picture {
                return Ok(());
            }
            if started.elapsed() > LIMIT {
                ensure!(grabbed.dimensions() == picture.dimensions(), "it shows {:?} px", grabbed.dimensions());
                let differ = grabbed.pixels().zip(picture.pixels()).filter(|(a, b)| a != b).count();
                bail!("{differ} of {} pixels differ", picture.pixels().len());
            }
            thread::sleep(Duration::from_millis(50));
        }
    }
}

/// An X11 server without a screen.
pub struct Xvfb {
    server: Server,
    display: String,
    size_px: [u32; 2],
}

impl Xvfb {
    /// Starts one with a screen of so many columns and rows.
    ///
    /// # Errors
    /// Where it is not installed, or does not come up.
    pub fn start(size_px: [u32; 2]) -> Result<Self> {
        // A number of its own: one that is free might be that of another test's server, which is about to be started again.
        static STARTED: AtomicU32 = AtomicU32::new(0);
        let number = 1000 + std::process::id() % 5000 * 10 + STARTED.fetch_add(1, Ordering::Relaxed);
        Self::start_as(&format!(":{number}"), size_px)
    }

    fn start_as(display: &str, size_px: [u32; 2]) -> Result<Self> {
        let screen = format!("{}x{}x24", size_px[0], size_px[1]);
        let mut command = Command::new("Xvfb");
        // It tells its number when it is ready.
        command.arg(display).args(["-displayfd", "1", "-nolisten", "tcp", "-noreset", "-screen", "0", &screen]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().context(HINT)?;
        let pipe = child.stdout.take().context("taking Xvfb's output")?;
        let server = Server(child);
        let mut told = String::new();
        BufReader::new(pipe).read_line(&mut told).context("hearing of Xvfb's display")?;
        ensure!(!told.trim().is_empty(), "Xvfb did not come up");
        Ok(Self { server, display: display.into(), size_px })
    }

    /// Changes its monitors, by the arguments of `xrandr`.
    ///
    /// # Errors
    /// Where that is not installed, or does not like them.
    pub fn monitors(&self, arguments: &str) -> Result<()> {
        let mut command = Command::new("xrandr");
        command.args(["-display", &self.display]).args(arguments.split(' ')).stdout(Stdio::null());
        let status = command.status().context("hint: packaging/test installs x11-xserver-utils")?;
        ensure!(status.success(), "xrandr {arguments} ends with {status}");
        Ok(())
    }

    /// Starts another one in the place of one that has gone.
    ///
    /// # Errors
    /// As [`Xvfb::start`].
    pub fn restart(&mut self) -> Result<()> {
        self.server.kill();
        *self = Self::start_as(&self.display.clone(), self.size_px)?;
        Ok(())
    }
}

impl Desktop for Xvfb {
    fn server(&self) -> String {
        self.display.clone()
    }

    fn grab(&self) -> Result<RgbImage> {
        let mut xwd = Command::new("xwd");
        let mut xwd =
            xwd.args(["-root", "-silent", "-display", &self.display]).stdout(Stdio::piped()).spawn().context(HINT)?;
        let dump = xwd.stdout.take().context("taking xwd's output")?;
        let netpbm = Command::new("xwdtopnm").arg("-quiet").stdin(dump).output().context(HINT)?;
        ensure!(xwd.wait()?.success() && netpbm.status.success(), "no picture of {}", self.display);
        portable_pixmap(&netpbm.stdout).context("xwdtopnm's picture is none")
    }

    fn crash(&mut self) {
        self.server.kill();
    }

    fn signal(&self, signal: Signal) -> Result<()> {
        self.server.signal(signal)
    }
}

/// A picture of Netpbm's binary kind, eight bits a channel.
fn portable_pixmap(bytes: &[u8]) -> Option<RgbImage> {
    let mut parts = bytes.splitn(5, |byte| byte.is_ascii_whitespace());
    let mut word = || std::str::from_utf8(parts.next()?).ok();
    let (magic, width, height, most) = (word()?, word()?.parse().ok()?, word()?.parse().ok()?, word()?);
    ((magic, most) == ("P6", "255")).then_some(())?;
    RgbImage::from_raw(width, height, parts.next()?.to_vec())
}

/// A Wayland compositor without a screen.
pub struct Weston {
    server: Server,
    folder: TempDir,
}

impl Weston {
    /// Starts one of so many columns and rows.
    ///
    /// # Errors
    /// Where it is not installed, or does not come up.
    pub fn start(size_px: [u32; 2]) -> Result<Self> {
        let folder = tempfile::tempdir().context("making a folder")?;
        let child = Command::new("weston")
            .args(["--backend=headless-backend.so", "--use-pixman", "--idle-time=0"])
            // Lets weston-screenshooter take pictures.
            .args(["--debug", "--no-config", "--socket=desktop"])
            .args([format!("--width={}", size_px[0]), format!("--height={}", size_px[1])])
            .env("XDG_RUNTIME_DIR", folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .context(HINT)?;
        let weston = Self { server: Server(child), folder };
        let started = Instant::now();
        while !weston.socket().exists() {
            ensure!(started.elapsed() < LIMIT, "weston did not come up");
            thread::sleep(Duration::from_millis(20));
        }
        Ok(weston)
    }

    fn socket(&self) -> PathBuf {
        self.folder.path().join("desktop")
    }
}

impl Desktop for Weston {
    fn server(&self) -> String {
        self.socket().display().to_string()
    }

    fn grab(&self) -> Result<RgbImage> {
        // It writes into the folder that it is in, under a name of its own.
        let pictures = tempfile::tempdir_in(self.folder.path())?;
        let mut command = Command::new("weston-screenshooter");
        command.current_dir(&pictures).env("XDG_RUNTIME_DIR", self.folder.path()).env("WAYLAND_DISPLAY", "desktop");
        let output = command.output().context(HINT)?;
        ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let written = fs::read_dir(&pictures)?.next().context("weston-screenshooter wrote nothing")??;
        Ok(::image::load_from_memory_with_format(&fs::read(written.path())?, ImageFormat::Png)?.into_rgb8())
    }

    fn crash(&mut self) {
        self.server.kill();
    }

    fn signal(&self, signal: Signal) -> Result<()> {
        self.server.signal(signal)
    }
}
