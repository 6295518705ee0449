//! One thread of low priority for what takes long: reading files and building structures.
//!
//! Jobs are done one after the other, so that many clients who load at once do not need many files' memory at once, and so
//! that frames share the processors with one such job at most.

use std::sync::mpsc::{Sender, channel, sync_channel};

use rustix::process::nice;

/// Added to the thread's nice value. Where frames leave a processor idle it does not matter; where frames want all of them, as
/// a software driver's do, a build gets a tenth of one: enough to end, too little to be seen.
const NICER_BY: i32 = 10;

type Job = Box<dyn FnOnce() + Send>;

/// The thread has gone, since the process ends.
#[derive(Debug, thiserror::Error)]
#[error("the thread that builds structures has gone")]
pub struct Gone;

/// The thread; it ends when this is dropped and what was begun is done.
pub struct Background {
    jobs: Sender<Job>,
}

impl Background {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start() -> std::io::Result<Self> {
        let (jobs, waiting) = channel::<Job>();
        std::thread::Builder::new().name("structures".into()).spawn(move || {
            // On Linux the value is the thread's own. Builds that are not nice are builds all the same; a real-time policy that
            // the process was started with is not left.
            if let Err(error) = nice(NICER_BY) {
                tracing::warn!(%error, "structures are built at the priority of frames, which may come late meanwhile");
            }
            for job in waiting {
                job();
            }
        })?;
        Ok(Self { jobs })
    }

    /// Does a job on the thread, and waits until it is done. Who waits is bounded by whom the control socket serves.
    ///
    /// # Errors
    /// [`Gone`].
    pub fn run<T: Send + 'static>(&self, job: impl FnOnce() -> T + Send + 'static) -> Result<T, Gone> {
        let (reply, answer) = sync_channel(1);
        let job = move || {
            // Whoever asked waits right below.
            let _ = reply.send(job());
        };
        self.jobs.send(Box::new(job)).map_err(|_| Gone)?;
        answer.recv().map_err(|_| Gone)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_are_done_on_a_nicer_thread_and_others_stay_as_they_are() {
        let here = nice(0).unwrap();
        let background = Background::start().unwrap();
        assert_eq!(background.run(|| nice(0).unwrap()).unwrap(), (here + NICER_BY).min(19));
        assert_eq!(background.run(|| std::thread::current().name().map(str::to_owned)).unwrap().unwrap(), "structures");
        assert_eq!(nice(0).unwrap(), here);
    }
}
