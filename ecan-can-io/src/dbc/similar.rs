//! Names that are similar to one that does not exist.

use thiserror::Error;

/// Least similarity of a listed name (Jaro-Winkler), and most names.
const LEAST_SIMILARITY: f64 = 0.8;
const MOST_NAMES: usize = 5;

/// A name that does not exist.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("unknown {what} \"{name}\"{}", list(.similar))]
pub struct UnknownName {
    /// Kind of the name.
    pub what: &'static str,
    /// The name.
    pub name: String,
    /// Existing names that are similar, the most similar first.
    pub similar: Vec<String>,
}

fn list(similar: &[String]) -> String {
    match similar {
        [] => String::new(),
        names => format!("; similar: {}", names.join(", ")),
    }
}

/// Index of a name.
pub fn find<'a>(
    what: &'static str,
    name: &str,
    names: impl Iterator<Item = &'a str> + Clone,
) -> Result<usize, UnknownName> {
    names.clone().position(|it| it == name).ok_or_else(|| UnknownName {
        what,
        name: name.to_owned(),
        similar: similar_to(name, names),
    })
}

/// Names that are similar, the most similar first; upper and lower case do not count.
pub fn similar_to<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let wanted = name.to_lowercase();
    let similarity = |it: &str| {
        let it = it.to_lowercase();
        match it.contains(&wanted) && wanted.len() >= 3 {
            true => 1.0,
            false => strsim::jaro_winkler(&it, &wanted),
        }
    };
    let mut rated: Vec<_> = names.map(|it| (similarity(it), it)).collect();
    rated.retain(|(similarity, _)| *similarity >= LEAST_SIMILARITY);
    rated.sort_by(|a, b| b.0.total_cmp(&a.0));
    rated.into_iter().take(MOST_NAMES).map(|(_, it)| it.to_owned()).collect()
}
