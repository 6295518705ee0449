//! Reading a TOML tree with a finger on the text: every value knows its place, and what is wrong is noted, not thrown.
//!
//! A reader that finds a problem notes it and gives `None`, and the reading goes on, so that one run finds everything.

use crate::calibration::Matrix4;
use crate::places::Places;
use crate::problem::Problem;
use std::cell::RefCell;
use std::ops::{Range, RangeInclusive};
use toml::de::{DeTable, DeValue};

/// The text that is read, and what has been found wrong with it.
pub(crate) struct Source<'a> {
    file: &'a str,
    text: &'a str,
    problems: RefCell<Vec<Problem>>,
    places: RefCell<Places>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(file: &'a str, text: &'a str) -> Self {
        Self { file, text, problems: RefCell::default(), places: RefCell::default() }
    }

    /// Line and column, both from 1, of a place in bytes.
    fn line_and_column(&self, at: usize) -> (usize, usize) {
        // Spans come from the parser, but a place just past the end is possible and must not panic.
        let mut start = at.min(self.text.len());
        while !self.text.is_char_boundary(start) {
            start -= 1;
        }
        let before = &self.text[..start];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// Notes a problem with what stands at `span`, in bytes.
    pub(crate) fn problem(&self, span: &Range<usize>, message: impl Into<String>, hint: impl Into<String>) {
        let (line, column) = self.line_and_column(span.start);
        self.problems.borrow_mut().push(Problem {
            file: self.file.to_owned(),
            line,
            column,
            message: message.into(),
            hint: hint.into(),
        });
    }

    /// Every problem that was noted, in the file's order, and every place.
    pub(crate) fn finish(self) -> (Vec<Problem>, Places) {
        let mut problems = self.problems.into_inner();
        problems.sort_by_key(|problem| (problem.line, problem.column));
        (problems, self.places.into_inner())
    }
}

/// A table and the keys that were asked of it.
pub(crate) struct Table<'a> {
    source: &'a Source<'a>,
    entries: &'a DeTable<'a>,
    span: Range<usize>,
    path: String,
    known: RefCell<Vec<&'static str>>,
}

impl<'a> Table<'a> {
    pub(crate) fn root(source: &'a Source<'a>, entries: &'a DeTable<'a>) -> Self {
        Self { source, entries, span: 0..0, path: String::new(), known: RefCell::default() }
    }

    pub(crate) fn problem(&self, message: impl Into<String>, hint: impl Into<String>) {
        self.source.problem(&self.span, message, hint);
    }

    /// Notes where this table and all that it holds stand, for those who find something wrong with it later.
    pub(crate) fn note_places(&self, name: &str) {
        let mut places = self.source.places.borrow_mut();
        places.insert(name.to_owned(), self.source.line_and_column(self.span.start));
        let mut tables = vec![(name.to_owned(), self.entries)];
        while let Some((name, table)) = tables.pop() {
            for (key, value) in table {
                let name = format!("{name}.{}", key.get_ref());
                places.insert(name.clone(), self.source.line_and_column(value.span().start));
                if let DeValue::Table(inner) = value.get_ref() {
                    tables.push((name, inner));
                }
            }
        }
    }

    /// The key's value, if it is there.
    pub(crate) fn get(&self, key: &'static str) -> Option<Value<'a>> {
        self.known.borrow_mut().push(key);
        let (_, value) = self.entries.iter().find(|(name, _)| name.get_ref() == key)?;
        Some(Value { source: self.source, value: value.get_ref(), span: value.span(), path: self.path_of(key) })
    }

    /// The key's value; that it is missing is a problem, whose remedy is an example.
    pub(crate) fn required(&self, key: &'static str, example: &str) -> Option<Value<'a>> {
        let value = self.get(key);
        if value.is_none() {
            let place = if self.path.is_empty() { "the file".to_owned() } else { format!("[{}]", self.path) };
            self.problem(format!("{place} has no `{key}`, which is required"), format!("add {key} = {example}"));
        }
        value
    }

    /// The key's array of tables; empty if it is not there.
    pub(crate) fn tables(&self, key: &'static str) -> Vec<Table<'a>> {
        let Some(value) = self.get(key) else { return Vec::new() };
        match value.value {
            DeValue::Array(_) => value.items().iter().filter_map(Value::table).collect(),
            _ => {
                let hint = format!("write [[{0}]], with two brackets, above each {0}", value.path);
                value.problem(format!("`{}` is {}, not a list of tables", value.path, value.kind()), hint);
                Vec::new()
            }
        }
    }

    /// All entries, for a table whose keys are the user's own.
    pub(crate) fn entries(&self) -> Vec<(&'a str, Range<usize>, Value<'a>)> {
        let entry = |(key, value): (&'a toml::Spanned<std::borrow::Cow<'a, str>>, &'a toml::Spanned<DeValue<'a>>)| {
            let path = self.path_of(key.get_ref());
            let value = Value { source: self.source, value: value.get_ref(), span: value.span(), path };
            (key.get_ref().as_ref(), key.span(), value)
        };
        self.entries.iter().map(entry).collect()
    }

    /// The `name`s in the list of tables at `path`, whatever else is right or wrong there; notes nothing.
    pub(crate) fn names_at(&self, path: &[&str]) -> Vec<String> {
        let mut tables = vec![self.entries];
        for key in path {
            let found = tables.iter().filter_map(|table| table.iter().find(|(name, _)| name.get_ref() == key));
            let inner = found.flat_map(|(_, value)| match value.get_ref() {
                DeValue::Table(table) => vec![table],
                DeValue::Array(items) => items.iter().filter_map(|item| item.get_ref().as_table()).collect(),
                _ => Vec::new(),
            });
            tables = inner.collect();
        }
        let name = |table: &&DeTable<'a>| {
            let (_, value) = table.iter().find(|(name, _)| name.get_ref() == "name")?;
            value.get_ref().as_str().map(str::to_owned)
        };
        tables.iter().filter_map(name).collect()
    }

    /// Notes each key that nobody asked for, with the nearest of those that somebody did.
    pub(crate) fn finish(self) {
        let mut known = self.known.into_inner();
        known.sort_unstable();
        for key in self.entries.keys().filter(|key| !known.contains(&key.get_ref().as_ref())) {
            let place = if self.path.is_empty() { "the file".to_owned() } else { format!("[{}]", self.path) };
            let nearest = known.iter().min_by_key(|name| strsim::damerau_levenshtein(name, key.get_ref()));
            let hint = nearest.map(|name| format!("did you mean `{name}`? {place} knows {}", known.join(", ")));
            let message = format!("unknown key `{}` in {place}", key.get_ref());
            self.source.problem(&key.span(), message, hint.unwrap_or_else(|| "remove it".to_owned()));
        }
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}

/// A value, its place in the text and its path from the root.
pub(crate) struct Value<'a> {
    source: &'a Source<'a>,
    value: &'a DeValue<'a>,
    span: Range<usize>,
    /// Such as `projector.calibration.view`.
    pub(crate) path: String,
}

impl<'a> Value<'a> {
    /// Notes a problem with it.
    pub(crate) fn problem(&self, message: impl Into<String>, hint: impl Into<String>) {
        self.source.problem(&self.span, message, hint);
    }

    /// Notes a problem with something beside it, such as its key.
    pub(crate) fn problem_at(&self, span: &Range<usize>, message: impl Into<String>, hint: impl Into<String>) {
        self.source.problem(span, message, hint);
    }

    fn kind(&self) -> String {
        let kind = self.value.type_str();
        let article = if kind.starts_with(['a', 'i']) { "an" } else { "a" };
        format!("{article} {kind}")
    }

    fn expected<T>(&self, what: &str) -> Option<T> {
        self.problem(format!("`{}` is {}", self.path, self.kind()), format!("{what} is expected"));
        None
    }

    pub(crate) fn table(&self) -> Option<Table<'a>> {
        match self.value {
            DeValue::Table(entries) => Some(Table {
                source: self.source,
                entries,
                span: self.span.clone(),
                path: self.path.clone(),
                known: RefCell::default(),
            }),
            _ => self.expected("a table"),
        }
    }

    /// The items of an array, each under the array's own path; of anything else, none.
    fn items(&self) -> Vec<Value<'a>> {
        let DeValue::Array(items) = self.value else { return Vec::new() };
        let item = |item: &'a toml::Spanned<DeValue<'a>>| Value {
            source: self.source,
            value: item.get_ref(),
            span: item.span(),
            path: self.path.clone(),
        };
        items.iter().map(item).collect()
    }

    pub(crate) fn array(&self, of: &str) -> Option<Vec<Value<'a>>> {
        if self.value.is_array() { Some(self.items()) } else { self.expected(&format!("an array of {of}")) }
    }

    pub(crate) fn string(&self) -> Option<String> {
        match self.value {
            DeValue::String(text) => Some(text.to_string()),
            _ => self.expected("a string in double quotes"),
        }
    }

    /// Whether it is one, for values of more than one type.
    pub(crate) fn is_string(&self) -> bool {
        self.value.is_str()
    }

    /// A string or, where people write a bare index, its digits.
    pub(crate) fn string_or_index(&self) -> Option<String> {
        match self.value {
            DeValue::Integer(index) => Some(index.to_string()),
            _ => self.string(),
        }
    }

    /// A string or, where people write a bare number, its digits.
    pub(crate) fn string_or_number(&self) -> Option<String> {
        match self.value {
            DeValue::Integer(number) => Some(number.to_string()),
            DeValue::Float(number) => Some(number.to_string()),
            _ => self.string(),
        }
    }

    /// A name: not empty, no control characters, at most 200 bytes.
    pub(crate) fn name(&self) -> Option<String> {
        let name = self.string()?;
        if name.is_empty() || name.len() > 200 || name.chars().any(char::is_control) {
            self.problem(format!("`{}` is no usable name", self.path), "take 1 to 200 characters that can be shown");
            return None;
        }
        Some(name)
    }

    pub(crate) fn boolean(&self) -> Option<bool> {
        self.value.as_bool().or_else(|| self.expected("true or false"))
    }

    pub(crate) fn integer(&self, range: RangeInclusive<u64>) -> Option<u64> {
        let DeValue::Integer(integer) = self.value else {
            return self.expected(&format!("a whole number from {} to {}", range.start(), range.end()));
        };
        let number = u64::from_str_radix(integer.as_str(), integer.radix()).ok().filter(|n| range.contains(n));
        if number.is_none() {
            let hint = format!("take a whole number from {} to {}", range.start(), range.end());
            self.problem(format!("`{}` is {integer}", self.path), hint);
        }
        number
    }

    /// Like [`integer`](Self::integer), for ranges that fit 32 bits.
    pub(crate) fn integer_u32(&self, range: RangeInclusive<u32>) -> Option<u32> {
        let number = self.integer(u64::from(*range.start())..=u64::from(*range.end()))?;
        u32::try_from(number).ok()
    }

    /// A finite number.
    pub(crate) fn number(&self) -> Option<f64> {
        let number = match self.value {
            DeValue::Integer(n) => i64::from_str_radix(n.as_str(), n.radix()).ok().map(|n| n as f64),
            DeValue::Float(n) => n.as_str().parse().ok(),
            _ => return self.expected("a number"),
        };
        let finite = number.filter(|n: &f64| n.is_finite());
        if finite.is_none() {
            self.problem(format!("`{}` holds a number that is not finite", self.path), "take a finite number");
        }
        finite
    }

    /// A finite number in a range; `allowed` says which in words.
    pub(crate) fn number_where(&self, allowed: &str, is_good: impl Fn(f64) -> bool) -> Option<f64> {
        let number = self.number()?;
        if !is_good(number) {
            self.problem(format!("`{}` holds {number}", self.path), format!("take a number {allowed}"));
            return None;
        }
        Some(number)
    }

    /// An array of exactly `N` finite numbers.
    pub(crate) fn numbers<const N: usize>(&self) -> Option<[f64; N]> {
        self.numbers_where("", |_| true)
    }

    /// An array of exactly `N` finite numbers, each in a range.
    pub(crate) fn numbers_where<const N: usize>(
        &self,
        allowed: &str,
        is_good: impl Fn(f64) -> bool,
    ) -> Option<[f64; N]> {
        let items = self.array(&format!("{N} numbers"))?;
        if items.len() != N {
            let message = format!("`{}` has {} entries instead of {N}", self.path, items.len());
            self.problem(message, format!("write {N} numbers"));
            return None;
        }
        // Every entry is read before any is missed, so that all bad ones are noted.
        let numbers: Vec<_> = items.iter().map(|item| item.number_where(allowed, &is_good)).collect();
        numbers.into_iter().collect::<Option<Vec<f64>>>()?.try_into().ok()
    }

    /// A matrix of four rows of four finite numbers that can be inverted.
    pub(crate) fn matrix(&self) -> Option<Matrix4> {
        let rows = self.array("4 rows of 4 numbers")?;
        if rows.len() != 4 {
            let message = format!("`{}` has {} rows instead of 4", self.path, rows.len());
            self.problem(message, "write 4 rows of 4 numbers: [[…], […], […], […]]");
            return None;
        }
        let rows: Vec<_> = rows.iter().map(Value::numbers::<4>).collect();
        let matrix: Matrix4 = rows.into_iter().collect::<Option<Vec<_>>>()?.try_into().ok()?;
        if is_singular(&matrix) {
            let hint = "its rows must be independent; rows are written from the top, translation in the last column";
            self.problem(format!("`{}` is singular: it cannot be inverted", self.path), hint);
            return None;
        }
        Some(matrix)
    }

    /// One of a few words.
    pub(crate) fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Option<T> {
        let word = self.string()?;
        let found = choices.iter().find(|(name, _)| *name == word).map(|(_, choice)| *choice);
        if found.is_none() {
            let names: Vec<_> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
            let nearest = choices.iter().map(|(name, _)| *name).min_by_key(|n| strsim::damerau_levenshtein(n, &word));
            let hint = format!("did you mean \"{}\"? there are {}", nearest.unwrap_or_default(), names.join(", "));
            self.problem(format!("`{}` is \"{word}\"", self.path), hint);
        }
        found
    }
}

/// Whether no digit of the inverse would be left: the determinant beside the product of the row lengths (Hadamard's
/// bound), which no scaling of rows changes.
fn is_singular(rows: &Matrix4) -> bool {
    let unit_rows = rows.map(|row| {
        let row = glam::DVec4::from_array(row);
        (row / row.abs().max_element()).normalize().to_array()
    });
    // Of the transpose, which has the same determinant. A row of zeros gives NaN, which is no number above the bound.
    let determinant = glam::DMat4::from_cols_array_2d(&unit_rows).determinant().abs();
    determinant.is_nan() || determinant < 1e-13
}
