//! Where the entries of a configuration stand in its text.

use std::collections::BTreeMap;

/// Lines and columns, both from 1, by the names of entries: `scene.node "car"` is the table, `scene.node "car".uri` a value
/// in it. Known are `daemon`, `scene`, and the tables `scene.node`, `scene.material`,
/// `scene.light`, `body`, `tracker` and `projector` each with its name as `{:?}` writes it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Places(BTreeMap<String, (usize, usize)>);

impl Places {
    pub(crate) fn insert(&mut self, name: String, line_and_column: (usize, usize)) {
        self.0.insert(name, line_and_column);
    }

    /// The place of an entry, or of the nearest that is around it; `None` where nothing of it is in the text.
    pub fn of(&self, name: &str) -> Option<(usize, usize)> {
        let around = |name: &str| self.0.get(name).copied();
        let ends = name.rmatch_indices('.').map(|(at, _)| &name[..at]);
        std::iter::once(name).chain(ends).find_map(around)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_there_is_where_its_table_is() {
        let mut places = Places::default();
        places.insert("scene".into(), (1, 1));
        places.insert("scene.node \"a.b\"".into(), (3, 1));
        places.insert("scene.node \"a.b\".uri".into(), (5, 7));
        assert_eq!(places.of("scene.node \"a.b\".uri"), Some((5, 7)));
        assert_eq!(places.of("scene.node \"a.b\".role"), Some((3, 1)));
        assert_eq!(places.of("scene.environment.uri"), Some((1, 1)));
        assert_eq!(places.of("projector \"left\""), None);
    }
}
