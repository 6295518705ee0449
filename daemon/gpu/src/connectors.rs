//! The connectors of the machine's graphics cards, and what is plugged in there, as the kernel tells (`/sys/class/drm`).

use std::path::{Path, PathBuf};

/// Where the kernel tells of them.
const DRM: &str = "/sys/class/drm";

/// A connector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connector {
    /// Its card, such as `card0`.
    pub card: String,
    /// Its name, such as `DP-1`.
    pub name: String,
    /// Whether something is plugged in.
    pub connected: bool,
    /// Who that is.
    pub identity: Option<Identity>,
}

/// Who a screen says it is (EDID, VESA E-EDID 1.4, sections 3.4 and 3.10.3).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Manufacturer, product and serial number, such as `EPS-0123-00000042`: three letters, and hexadecimal digits.
    pub id: String,
    /// Its name in words, where it tells one.
    pub name: Option<String>,
}

impl Identity {
    /// Reads the base block of an EDID: 128 bytes with their sum of zero.
    pub fn read(edid: &[u8]) -> Option<Identity> {
        let base = edid.get(..128)?;
        let sum = base.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
        if base[..8] != [0, 255, 255, 255, 255, 255, 255, 0] || sum != 0 {
            return None;
        }
        let maker = u16::from_be_bytes([base[8], base[9]]);
        let letter = |shift: u16| char::from(b'@' + (maker >> shift & 31) as u8);
        let product = u16::from_le_bytes([base[10], base[11]]);
        let serial = u32::from_le_bytes([base[12], base[13], base[14], base[15]]);
        let id = format!("{}{}{}-{product:04X}-{serial:08X}", letter(10), letter(5), letter(0));

        // Four descriptors of 18 bytes; one of them may hold the name.
        let name = base[54..126].chunks_exact(18).find(|descriptor| descriptor[..5] == [0, 0, 0, 0xfc, 0]);
        let text = |descriptor: &[u8]| String::from_utf8_lossy(&descriptor[5..]).trim_end().to_owned();
        Some(Identity { id, name: name.map(text) })
    }

    /// Whether it is who a configuration names: by its id or a beginning of it that ends where a part does, or by its name.
    pub fn is(&self, wanted: &str) -> bool {
        let begins = || self.id.strip_prefix(wanted).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'));
        begins() || self.name.as_deref() == Some(wanted)
    }
}

impl Connector {
    /// All of the machine's, in the order of their names.
    pub fn all() -> Vec<Connector> {
        Connector::under(Path::new(DRM))
    }

    /// Those that a folder tells of, as `/sys/class/drm` does.
    pub fn under(folder: &Path) -> Vec<Connector> {
        // A machine without graphics has no such folder.
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let mut all: Vec<_> = entries.filter_map(|entry| Connector::read(&entry.ok()?.path())).collect();
        all.sort_by(|a, b| (&a.card, &a.name).cmp(&(&b.card, &b.name)));
        all
    }

    fn read(folder: &Path) -> Option<Connector> {
        let (card, name) = folder.file_name()?.to_str()?.split_once('-')?;
        let status = std::fs::read_to_string(folder.join("status")).ok()?;
        let edid = std::fs::read(folder.join("edid")).unwrap_or_default();
        Some(Connector {
            card: card.to_owned(),
            name: name.to_owned(),
            connected: status.trim() == "connected",
            identity: Identity::read(&edid),
        })
    }

    /// The same connector as it is now; None where the card has gone.
    pub fn now(&self) -> Option<Connector> {
        Connector::read(&Path::new(DRM).join(format!("{}-{}", self.card, self.name)))
    }

    /// The card's own file, which whoever shows something on it opens.
    pub fn device_file(&self) -> PathBuf {
        Path::new("/dev/dri").join(&self.card)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The base block of a screen, with its sum made right.
    fn edid(maker: [u8; 2], name: &[u8; 13]) -> Vec<u8> {
        let mut block = vec![0u8; 128];
        block[..8].copy_from_slice(&[0, 255, 255, 255, 255, 255, 255, 0]);
        block[8..10].copy_from_slice(&maker);
        block[10..16].copy_from_slice(&[0x23, 0x01, 0x42, 0, 0, 0]);
        block[72..77].copy_from_slice(&[0, 0, 0, 0xfc, 0]);
        block[77..90].copy_from_slice(name);
        block[127] = 0u8.wrapping_sub(block.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)));
        block
    }

    #[test]
    fn a_screen_is_known_by_its_edid() {
        // E, P and S are 5, 16 and 19.
        let maker = ((5u16 << 10) | (16 << 5) | 19).to_be_bytes();
        let mut block = edid(maker, b"EB-L200F\n    ");
        let identity = Identity::read(&block).unwrap();
        assert_eq!((identity.id.as_str(), identity.name.as_deref()), ("EPS-0123-00000042", Some("EB-L200F")));
        for (wanted, is) in [
            ("EPS-0123-00000042", true),
            ("EPS-0123", true),
            ("EB-L200F", true),
            ("EPS-01", false),
            ("EPS-0123-00000043", false),
            ("EB-L200", false),
        ] {
            assert_eq!(identity.is(wanted), is, "{wanted}");
        }
        block[20] ^= 1;
        assert_eq!(Identity::read(&block), None);
        assert_eq!(Identity::read(&block[..100]), None);
    }

    #[test]
    fn connectors_are_read_as_the_kernel_tells_them() {
        let folder = tempfile::tempdir().unwrap();
        let connector = |name: &str, status: &str, edid: &[u8]| {
            let path = folder.path().join(name);
            std::fs::create_dir(&path).unwrap();
            std::fs::write(path.join("status"), status).unwrap();
            std::fs::write(path.join("edid"), edid).unwrap();
        };
        connector("card1-HDMI-A-1", "connected\n", &edid([0x16, 0x13], b"beamer\n      "));
        connector("card0-DP-1", "disconnected\n", &[]);
        // Cards and render nodes are no connectors.
        std::fs::create_dir(folder.path().join("card0")).unwrap();
        std::fs::create_dir(folder.path().join("renderD128")).unwrap();
        let all = Connector::under(folder.path());
        let seen: Vec<_> = all.iter().map(|c| (c.card.as_str(), c.name.as_str(), c.connected)).collect();
        assert_eq!(seen, [("card0", "DP-1", false), ("card1", "HDMI-A-1", true)]);
        assert!(all[1].identity.as_ref().unwrap().is("beamer") && all[0].identity.is_none());
        assert_eq!(all[1].device_file(), Path::new("/dev/dri/card1"));
        assert_eq!(Connector::under(&folder.path().join("nothing")), []);
    }
}
