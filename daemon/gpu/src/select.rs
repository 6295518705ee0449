//! Which device serves: the configuration's `device.select`, or the best there is.

use crate::error::GpuError;
use crate::info::DeviceInfo;
use crate::ray_query::RayTracing;

/// The device that `select` names (an index, a UUID, or part of a name, in this order), or the best of those that can
/// serve: discrete, then integrated, then virtual, then a processor; of equals the first.
///
/// # Errors
/// [`GpuError::NoSuchDevice`] lists what there is; [`GpuError::Unsupported`] says what the chosen one lacks.
pub(crate) fn choose<'a>(devices: &'a [DeviceInfo], select: Option<&str>) -> Result<&'a DeviceInfo, GpuError> {
    let chosen = match select {
        Some(select) => named(devices, select).ok_or_else(|| GpuError::NoSuchDevice {
            select: select.into(),
            have: devices.iter().map(|d| format!("{} {:?}", d.index, d.name)).collect::<Vec<_>>().join(", "),
        })?,
        // min_by_key keeps the first of equals, and one that cannot serve comes last, to be refused with its reason.
        None => devices
            .iter()
            .min_by_key(|device| (!device.lacks.is_empty(), rank(device)))
            .ok_or_else(|| GpuError::NoDriver { detail: "the loader lists no device".into() })?,
    };
    if chosen.lacks.is_empty() {
        Ok(chosen)
    } else {
        Err(GpuError::Unsupported { device: format!("device {:?}", chosen.name), missing: chosen.lacks.join(", ") })
    }
}

/// Whether a device is opened with ray queries.
///
/// # Errors
/// [`GpuError::Unsupported`] where they are asked for and not there.
pub(crate) fn takes_ray_queries(device: &DeviceInfo, wanted: RayTracing) -> Result<bool, GpuError> {
    let there = device.abilities.get("ray_query").copied().unwrap_or_default();
    match wanted {
        RayTracing::Bvh => Ok(false),
        RayTracing::Auto => Ok(there && device.kind != "cpu"),
        RayTracing::RayQuery if there => Ok(true),
        RayTracing::RayQuery => Err(GpuError::Unsupported {
            device: format!("device {:?}", device.name),
            missing: "ray queries (VK_KHR_ray_query)".into(),
        }),
    }
}

fn named<'a>(devices: &'a [DeviceInfo], select: &str) -> Option<&'a DeviceInfo> {
    let bare = |text: &str| text.replace('-', "").to_lowercase();
    let by_index = select.parse::<usize>().ok().and_then(|index| devices.iter().find(|d| d.index == index));
    let by_uuid = || devices.iter().find(|d| !d.uuid.is_empty() && bare(&d.uuid) == bare(select));
    let by_name = || devices.iter().find(|d| d.name.to_lowercase().contains(&select.to_lowercase()));
    by_index.or_else(by_uuid).or_else(by_name)
}

fn rank(device: &DeviceInfo) -> u32 {
    match device.kind {
        "discrete" => 0,
        "integrated" => 1,
        "virtual" => 2,
        "cpu" => 3,
        _ => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn devices() -> Vec<DeviceInfo> {
        let device = |index, name: &str, kind, uuid: &str, lacks: &[&'static str]| DeviceInfo {
            index,
            name: name.into(),
            kind,
            uuid: uuid.into(),
            lacks: lacks.to_vec(),
            ..Default::default()
        };
        vec![
            device(0, "llvmpipe (LLVM 15)", "cpu", "6d657361-3232-2e33-2e36-000000000000", &[]),
            device(1, "Old Discrete", "discrete", "", &["Vulkan 1.3"]),
            device(2, "GeForce RTX 3090", "discrete", "00000000-0000-0000-0000-0000000000ab", &[]),
            device(3, "Intel UHD", "integrated", "00000000-0000-0000-0000-0000000000cd", &[]),
        ]
    }

    #[test]
    fn the_best_that_can_serve_is_chosen() {
        assert_eq!(choose(&devices(), None).unwrap().index, 2);
        assert_eq!(choose(&devices()[..2], None).unwrap().index, 0);
        assert!(matches!(choose(&[], None), Err(GpuError::NoDriver { .. })));
    }

    #[test]
    fn a_device_is_named_by_index_uuid_or_part_of_its_name() {
        let all = devices();
        for (select, index) in [
            ("0", 0),
            ("LLVMpipe", 0),
            ("3090", 2),
            ("00000000-0000-0000-0000-0000000000CD", 3),
            ("000000000000000000000000000000cd", 3),
        ] {
            assert_eq!(choose(&all, Some(select)).unwrap().index, index, "{select}");
        }
    }

    #[test]
    fn ray_queries_are_taken_where_they_are_there_and_worth_it() {
        let device = |kind, there| DeviceInfo { kind, abilities: [("ray_query", there)].into(), ..Default::default() };
        let taken = |device: &DeviceInfo, wanted| takes_ray_queries(device, wanted).ok();
        for (kind, there, by_auto, by_name) in [
            ("discrete", true, true, Some(true)),
            ("discrete", false, false, None),
            ("cpu", true, false, Some(true)),
            ("cpu", false, false, None),
        ] {
            let device = device(kind, there);
            assert_eq!(taken(&device, RayTracing::Auto), Some(by_auto), "{kind}, {there}");
            assert_eq!(taken(&device, RayTracing::RayQuery), by_name, "{kind}, {there}");
            assert_eq!(taken(&device, RayTracing::Bvh), Some(false), "{kind}, {there}");
        }
        let error = takes_ray_queries(&device("cpu", false), RayTracing::RayQuery).unwrap_err().to_string();
        assert!(error.contains("lacks ray queries"), "{error}");
    }

    #[test]
    fn what_is_not_there_or_lacks_something_is_refused_with_the_reason() {
        let error = choose(&devices(), Some("radeon")).unwrap_err().to_string();
        assert!(error.contains("radeon") && error.contains("0 \"llvmpipe"), "{error}");
        let error = choose(&devices(), Some("old")).unwrap_err().to_string();
        assert!(error.contains("lacks Vulkan 1.3"), "{error}");
    }
}
