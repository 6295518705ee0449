//! Which call is to fail, and what was called so far.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use ash::vk;

/// A call that is to fail.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    name: String,
    /// Counted from 1, since it was armed.
    nth: u64,
    result: vk::Result,
    /// Whether all later ones fail as well.
    stays: bool,
}

impl FromStr for Fault {
    type Err = String;

    /// `NAME NTH RESULT once|on`, where the result is its number.
    fn from_str(text: &str) -> Result<Self, String> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let [name, nth, result, lasts] = words[..] else {
            return Err(format!("{text:?} is not NAME NTH RESULT once|on"));
        };
        let number = |word: &str| word.parse::<i64>().map_err(|error| format!("{word:?}: {error}"));
        let result = i32::try_from(number(result)?).map_err(|error| error.to_string())?;
        let nth = u64::try_from(number(nth)?).map_err(|error| error.to_string())?;
        let stays = match lasts {
            "once" => false,
            "on" => true,
            other => return Err(format!("{other:?} is neither once nor on")),
        };
        Ok(Fault { name: name.to_owned(), nth, result: vk::Result::from_raw(result), stays })
    }
}

/// What is counted, and what is to come.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    fault: Option<Fault>,
    fired: u64,
    counts: BTreeMap<&'static str, u64>,
    strangers: BTreeSet<String>,
}

impl Plan {
    pub(crate) const fn new() -> Self {
        Plan { fault: None, fired: 0, counts: BTreeMap::new(), strangers: BTreeSet::new() }
    }

    /// Forgets all counts, and arms a fault or none.
    pub(crate) fn begin(&mut self, fault: Option<Fault>) {
        (self.fault, self.fired) = (fault, 0);
        self.counts.clear();
    }

    /// Counts a call; `Some` where it is to fail.
    pub(crate) fn call(&mut self, name: &'static str) -> Option<vk::Result> {
        let count = self.counts.entry(name).or_default();
        *count += 1;
        let fault = self.fault.as_ref().filter(|fault| fault.name == name)?;
        let comes = *count == fault.nth || (fault.stays && *count > fault.nth);
        self.fired += u64::from(comes);
        comes.then_some(fault.result)
    }

    /// Takes note of something enabled or called that nobody knows.
    pub(crate) fn stranger(&mut self, name: &str) {
        self.strangers.insert(name.to_owned());
    }

    /// All of it on one line: `fired=N strangers=A,B counts=NAME:N,NAME:N`.
    pub(crate) fn report(&self) -> String {
        let strangers: Vec<&str> = self.strangers.iter().map(String::as_str).collect();
        let counts: Vec<String> = self.counts.iter().map(|(name, count)| format!("{name}:{count}")).collect();
        format!("fired={} strangers={} counts={}", self.fired, strangers.join(","), counts.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn armed(text: &str) -> Plan {
        let mut plan = Plan::new();
        plan.begin(Some(text.parse().unwrap()));
        plan
    }

    #[test]
    fn the_nth_call_of_a_name_fails_once() {
        let mut plan = armed("vkA 2 -4 once");
        let results: Vec<_> = ["vkA", "vkB", "vkB", "vkA", "vkA"].map(|name| plan.call(name)).into();
        assert_eq!(results, [None, None, None, Some(vk::Result::ERROR_DEVICE_LOST), None]);
        assert_eq!(plan.report(), "fired=1 strangers= counts=vkA:3,vkB:2");
    }

    #[test]
    fn or_from_then_on() {
        let mut plan = armed("vkA 2 2 on");
        let results: Vec<_> = ["vkA", "vkA", "vkA"].map(|name| plan.call(name)).into();
        assert_eq!(results, [None, Some(vk::Result::TIMEOUT), Some(vk::Result::TIMEOUT)]);
        plan.stranger("VK_NEW_thing");
        assert_eq!(plan.report(), "fired=2 strangers=VK_NEW_thing counts=vkA:3");
        plan.begin(None);
        assert_eq!((plan.call("vkA"), plan.report().as_str()), (None, "fired=0 strangers=VK_NEW_thing counts=vkA:1"));
    }

    #[test]
    fn other_words_are_refused() {
        for text in ["", "vkA", "vkA 1 -4", "vkA one -4 once", "vkA 1 -4 ever", "vkA -1 -4 on", "vkA 1 99999999999 on"]
        {
            assert!(text.parse::<Fault>().is_err(), "{text:?}");
        }
    }
}
