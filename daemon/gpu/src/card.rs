//! Graphics cards whose displays are taken over: for each one open file, whoever shows something there.
//!
//! The kernel lets one open file of a card set its modes, the *master*: the first, where there is no desktop. So two displays of a
//! card share that file, and a second one of it would be refused.
//!
//! What drivers make of `VK_EXT_acquire_drm_display` differs, and this serves both ways:
//!
//! - By the specification each display is acquired and released by itself, and the descriptor stays its caller's, who must not close
//!   it before.
//! - Mesa's (`wsi_common_display.c`) keeps one descriptor for all displays of a card. It refuses another (`INITIALIZATION_FAILED`)
//!   as long as it has one, shows on all displays by that, and releasing any of them closes it. Where it was the first to open the
//!   card, which it does when its instance is asked for devices, it has one from the beginning.
//!
//! So whatever was acquired stays so until the last display of the card goes; a refusal counts for nothing where the driver has a way
//! to the card already; and a driver is given a descriptor of its own, which is closed here where the driver has not done that.

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, IntoRawFd, OwnedFd, RawFd};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use ash::{ext, khr, vk};
use drm::control::Device as _;

use crate::instance::Instance;

/// What a driver does with displays.
pub(crate) trait Driver {
    /// Takes a display over, by a descriptor that it may keep.
    fn acquire(&self, fd: RawFd, display: vk::DisplayKHR) -> Result<(), vk::Result>;
    /// Whether it shows on a display without being given a descriptor.
    fn lists(&self, display: vk::DisplayKHR) -> Result<bool, vk::Result>;
    /// Gives a display back that it has taken over.
    fn release(&self, display: vk::DisplayKHR);
}

/// Vulkan's, with the extensions for displays.
pub(crate) struct Vulkan {
    instance: Arc<Instance>,
    physical: vk::PhysicalDevice,
}

impl Driver for Vulkan {
    fn acquire(&self, fd: RawFd, display: vk::DisplayKHR) -> Result<(), vk::Result> {
        let loader = ext::acquire_drm_display::Instance::new(self.instance.entry(), self.instance.raw());
        // SAFETY: the extension is enabled, the device was listed by this instance, and the descriptor stays open until the display is
        // released.
        unsafe { loader.acquire_drm_display(self.physical, fd, display) }
    }

    fn lists(&self, display: vk::DisplayKHR) -> Result<bool, vk::Result> {
        let loader = khr::display::Instance::new(self.instance.entry(), self.instance.raw());
        // SAFETY: the extension is enabled, and the device was listed by this instance.
        let listed = unsafe { loader.get_physical_device_display_properties(self.physical) }?;
        Ok(listed.iter().any(|of| of.display == display))
    }

    fn release(&self, display: vk::DisplayKHR) {
        let loader = ext::direct_mode_display::Instance::new(self.instance.entry(), self.instance.raw());
        // SAFETY: the display was acquired, and every surface on its card is gone, since each keeps the card. What the driver answers
        // changes nothing any more.
        let _ = unsafe { (loader.fp().release_display_ext)(self.physical, display) };
    }
}

/// A display that a driver has taken over, and the descriptor that it was given for that.
struct Taken {
    display: vk::DisplayKHR,
    fd: RawFd,
}

/// A card's file, for as long as anything is shown there.
pub(crate) struct Card<D: Driver = Vulkan> {
    file: File,
    driver: D,
    taken: Mutex<Vec<Taken>>,
}

/// The cards that are open.
static OPEN: Mutex<Vec<Weak<Card>>> = Mutex::new(Vec::new());

impl Card {
    /// The card of a file under `/dev/dri`, for a device: the one that is open already, or another.
    pub(crate) fn of(instance: &Arc<Instance>, physical: vk::PhysicalDevice, path: &Path) -> io::Result<Arc<Card>> {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|card| card.strong_count() > 0);
        let device = std::fs::metadata(path)?.rdev();
        for card in open.iter().filter_map(Weak::upgrade) {
            let of = &card.driver;
            if Arc::ptr_eq(&of.instance, instance) && of.physical == physical && card.file.metadata()?.rdev() == device
            {
                return Ok(card);
            }
        }
        let file = File::options().read(true).write(true).open(path)?;
        let card = Arc::new(Card::new(file, Vulkan { instance: Arc::clone(instance), physical }));
        open.push(Arc::downgrade(&card));
        Ok(card)
    }

    /// The driver's display at a connector, by the kernel's number of it.
    pub(crate) fn display(&self, connector_id: u32) -> Result<vk::DisplayKHR, vk::Result> {
        let Vulkan { instance, physical } = &self.driver;
        let loader = ext::acquire_drm_display::Instance::new(instance.entry(), instance.raw());
        // SAFETY: the extension is enabled, the device was listed by this instance, and the file is open.
        unsafe { loader.get_drm_display(*physical, self.file.as_raw_fd(), connector_id) }
    }

    /// The kernel's number of a connector.
    pub(crate) fn connector_id(&self, name: &str) -> io::Result<Option<u32>> {
        for handle in self.resource_handles()?.connectors() {
            let connector = self.get_connector(*handle, false)?;
            if format!("{}-{}", connector.interface().as_str(), connector.interface_id()) == name {
                return Ok(Some(u32::from(*handle)));
            }
        }
        Ok(None)
    }
}

impl<D: Driver> Card<D> {
    fn new(file: File, driver: D) -> Card<D> {
        Card { file, driver, taken: Mutex::default() }
    }

    /// Takes a display over until the last one of the card goes.
    pub(crate) fn acquire(&self, display: vk::DisplayKHR) -> Result<(), AcquireError> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        // A display that was unplugged and comes back is acquired again, by the descriptor that it had.
        let answer = match taken.iter().find(|of| of.display == display) {
            Some(of) => self.driver.acquire(of.fd, display),
            None => {
                let own = self.file.try_clone().map_err(AcquireError::System)?;
                let answer = self.driver.acquire(own.as_raw_fd(), display);
                if answer.is_ok() {
                    taken.push(Taken { display, fd: own.into_raw_fd() });
                }
                answer
            }
        };
        match answer {
            Err(vk::Result::ERROR_INITIALIZATION_FAILED)
                if !taken.is_empty() || self.driver.lists(display).is_ok_and(|lists| lists) =>
            {
                // The driver shows on it by what it has.
                Ok(())
            }
            answer => answer.map_err(AcquireError::Driver),
        }
    }

    /// Closes a descriptor that a driver was given and does not need any more, unless it has closed that itself: the number may then
    /// stand for something else.
    fn close(&self, fd: RawFd) {
        let same = |own: &std::fs::Metadata, is: &std::fs::Metadata| {
            (own.dev(), own.ino(), own.rdev()) == (is.dev(), is.ino(), is.rdev())
        };
        let is_open = self
            .file
            .metadata()
            .and_then(|own| Ok(same(&own, &std::fs::metadata(format!("/proc/self/fd/{fd}"))?)))
            .unwrap_or(false);
        if is_open {
            // SAFETY: it is still the card's file, which nobody else opens under the number that was given to the driver; and what the
            // driver did with it has ended.
            drop(unsafe { OwnedFd::from_raw_fd(fd) });
        }
    }
}

impl<D: Driver> Drop for Card<D> {
    fn drop(&mut self) {
        let taken = std::mem::take(self.taken.get_mut().unwrap_or_else(PoisonError::into_inner));
        for of in &taken {
            self.driver.release(of.display);
        }
        for of in taken {
            self.close(of.fd);
        }
    }
}

/// Why a display is not to be had.
#[derive(Debug, thiserror::Error)]
pub(crate) enum AcquireError {
    /// There are no descriptors left.
    #[error("its card cannot be shared: {0}")]
    System(io::Error),
    /// It is somebody else's.
    #[error("the driver answers {0}")]
    Driver(vk::Result),
}

impl AsFd for Card {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl drm::Device for Card {}
impl drm::control::Device for Card {}

#[cfg(test)]
mod tests {
    use super::*;
    use ash::vk::Handle;
    use std::cell::{Cell, RefCell};
    use std::rc::Rc;

    /// What a driver was asked for; it outlives the card.
    #[derive(Default)]
    struct Asked {
        acquired: RefCell<Vec<(RawFd, u64)>>,
        released: RefCell<Vec<u64>>,
        /// What another thread opened under the number that the driver closed.
        stranger: RefCell<Option<OwnedFd>>,
    }

    /// As the specification has it: each display by itself, and no word of closing.
    struct BySpecification(Rc<Asked>);

    impl Driver for BySpecification {
        fn acquire(&self, fd: RawFd, display: vk::DisplayKHR) -> Result<(), vk::Result> {
            self.0.acquired.borrow_mut().push((fd, display.as_raw()));
            Ok(())
        }

        fn lists(&self, _: vk::DisplayKHR) -> Result<bool, vk::Result> {
            Ok(true)
        }

        fn release(&self, display: vk::DisplayKHR) {
            self.0.released.borrow_mut().push(display.as_raw());
        }
    }

    /// As Mesa has it: one descriptor for all, which it closes.
    struct Mesa(Rc<Asked>, Cell<Option<RawFd>>);

    impl Driver for Mesa {
        fn acquire(&self, fd: RawFd, display: vk::DisplayKHR) -> Result<(), vk::Result> {
            if self.1.get().is_some() {
                return Err(vk::Result::ERROR_INITIALIZATION_FAILED);
            }
            self.1.set(Some(fd));
            self.0.acquired.borrow_mut().push((fd, display.as_raw()));
            Ok(())
        }

        fn lists(&self, _: vk::DisplayKHR) -> Result<bool, vk::Result> {
            Ok(self.1.get().is_some())
        }

        fn release(&self, display: vk::DisplayKHR) {
            self.0.released.borrow_mut().push(display.as_raw());
            if let Some(fd) = self.1.take() {
                // SAFETY: it was given to this driver, which closes it.
                let mut number = unsafe { OwnedFd::from_raw_fd(fd) };
                // Closed, and the number taken at once.
                rustix::io::dup2(File::open("/dev/zero").unwrap(), &mut number).unwrap();
                *self.0.stranger.borrow_mut() = Some(number);
            }
        }
    }

    /// A desktop runs on it.
    struct Refuses;

    impl Driver for Refuses {
        fn acquire(&self, _: RawFd, _: vk::DisplayKHR) -> Result<(), vk::Result> {
            Err(vk::Result::ERROR_INITIALIZATION_FAILED)
        }

        fn lists(&self, _: vk::DisplayKHR) -> Result<bool, vk::Result> {
            Ok(false)
        }

        fn release(&self, _: vk::DisplayKHR) {
            unreachable!("nothing was acquired");
        }
    }

    fn display(number: u64) -> vk::DisplayKHR {
        vk::DisplayKHR::from_raw(number)
    }

    /// How many descriptors of this process are open on a file.
    fn open_on(file: &File) -> usize {
        let own = file.metadata().unwrap();
        let numbers = std::fs::read_dir("/proc/self/fd").unwrap();
        let same = |path: &Path| std::fs::metadata(path).is_ok_and(|is| (is.dev(), is.ino()) == (own.dev(), own.ino()));
        numbers.filter(|entry| same(&entry.as_ref().unwrap().path())).count()
    }

    #[test]
    fn each_display_is_acquired_and_all_are_released_with_the_last_one() {
        let (file, asked) = (tempfile::tempfile().unwrap(), Rc::new(Asked::default()));
        let card = Card::new(file.try_clone().unwrap(), BySpecification(asked.clone()));
        card.acquire(display(1)).unwrap();
        card.acquire(display(2)).unwrap();
        // It was unplugged and came back.
        card.acquire(display(1)).unwrap();
        let acquired = asked.acquired.borrow().clone();
        let [(one, 1), (two, 2), (again, 1)] = acquired[..] else { panic!("{acquired:?}") };
        assert!(one == again && one != two && ![one, two].contains(&card.file.as_raw_fd()));
        assert_eq!((open_on(&file), asked.released.borrow().len()), (4, 0));
        drop(card);
        assert_eq!((asked.released.borrow().as_slice(), open_on(&file)), ([1, 2].as_slice(), 1));
    }

    #[test]
    fn a_driver_that_has_the_card_shows_on_its_other_displays_too_and_closes_what_it_was_given() {
        let (file, asked) = (tempfile::tempfile().unwrap(), Rc::new(Asked::default()));
        let card = Card::new(file.try_clone().unwrap(), Mesa(asked.clone(), Cell::default()));
        for number in [1, 2, 1] {
            card.acquire(display(number)).unwrap();
        }
        assert_eq!((asked.acquired.borrow().len(), open_on(&file)), (1, 3));
        drop(card);
        assert_eq!((asked.released.borrow().as_slice(), open_on(&file)), ([1].as_slice(), 1));
        // What has the number now is not the card's, and stays open.
        let stranger = asked.stranger.borrow_mut().take().unwrap();
        let is = std::fs::metadata(format!("/proc/self/fd/{}", stranger.as_raw_fd())).unwrap();
        assert_eq!(is.rdev(), std::fs::metadata("/dev/zero").unwrap().rdev());
    }

    #[test]
    fn a_driver_that_opened_the_card_first_is_asked_for_nothing_and_releases_nothing() {
        let (file, asked) = (tempfile::tempfile().unwrap(), Rc::new(Asked::default()));
        let own = file.try_clone().unwrap();
        let card = Card::new(file.try_clone().unwrap(), Mesa(asked.clone(), Cell::new(Some(own.as_raw_fd()))));
        card.acquire(display(1)).unwrap();
        card.acquire(display(2)).unwrap();
        drop(card);
        assert!(asked.acquired.borrow().is_empty() && asked.released.borrow().is_empty());
        assert_eq!(open_on(&file), 2);
        drop(own);
    }

    #[test]
    fn what_is_somebody_elses_is_refused() {
        let file = tempfile::tempfile().unwrap();
        let card = Card::new(file.try_clone().unwrap(), Refuses);
        let refused = card.acquire(display(1)).unwrap_err();
        assert!(matches!(refused, AcquireError::Driver(vk::Result::ERROR_INITIALIZATION_FAILED)), "{refused}");
        drop(card);
        assert_eq!(open_on(&file), 1);
    }
}
