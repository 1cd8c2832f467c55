//! Groups and datasets of a file, walked once, without following links to other files. Costs some kilobytes per dataset.

use super::attributes::{number, text, texts};
use super::committed::{self, Hidden};
use super::file::File;
use super::links::{Link, links_of};
use super::types::Stored;
use crate::array_choice::{Listed, ambiguous, is_shape_of_volume, listed, no_such, none, several};
use crate::cf::helpers_of;
use crate::error::{ImportError, Result};
use crate::note::Note;
use hdf5_reader::error::Error;
use hdf5_reader::group::Group;
use hdf5_reader::{Attribute, Dataset};
use std::collections::{HashMap, HashSet};

/// Most datasets and groups walked, and most levels.
const MOST_OBJECTS: usize = 20_000;
const MOST_LEVELS: usize = 64;

/// Groups of Imaris with one image each.
const LEVELS: &str = "/DataSet/ResolutionLevel ";

/// A dataset of the file.
pub(super) struct Entry {
    /// Path from the root, `/entry/data`.
    pub(super) path: String,
    pub(super) set: Dataset,
    pub(super) attributes: Vec<Attribute>,
    /// The type of its elements, or the unsupported one.
    pub(super) stored: Result<Stored, String>,
    /// Names of attributes that cannot be read.
    pub(super) unread: Vec<String>,
    /// Whether it is a further link to a dataset listed before.
    is_link: bool,
}

pub(super) struct GroupEntry {
    pub(super) path: String,
    pub(super) attributes: Vec<Attribute>,
}

/// Everything in the file.
pub(super) struct Tree {
    pub(super) groups: Vec<GroupEntry>,
    pub(super) sets: Vec<Entry>,
    /// Paths of further links to groups, and the paths under which these were walked.
    links: Vec<(String, String)>,
    /// Attributes that the parser does not read, by the address of their object.
    hidden: HashMap<u64, Hidden>,
    /// Paths of what cannot be read, and why.
    unread: Vec<(String, ImportError)>,
    /// Whether there is more.
    is_cut: bool,
}

/// The path of the group around an object.
pub(super) fn parent_of(path: &str) -> &str {
    match path.rsplit_once('/') {
        None | Some(("", _)) => "/",
        Some((parent, _)) => parent,
    }
}

/// Whether a group is a level of Imaris other than the finest, which is walked: many steps and channels leave no room for the others.
fn is_coarse_level(path: &str) -> bool {
    let level = path.rfind(LEVELS).and_then(|at| path.get(at + LEVELS.len()..));
    level.is_some_and(|level| level.parse::<u32>().is_ok_and(|level| level > 0))
}

pub(super) fn join(group: &str, name: &str) -> String {
    format!("{}/{name}", group.trim_end_matches('/'))
}

impl Entry {
    /// Whether it can be a volume by itself: numbers along 2 to 5 axes, at least two of them longer than 1.
    fn is_volume(&self) -> bool {
        is_shape_of_volume(self.set.shape()) && self.stored.is_ok() && !self.is_scale()
    }

    pub(super) fn is_scale(&self) -> bool {
        text(&self.attributes, "CLASS").is_some_and(|class| class == "DIMENSION_SCALE")
    }

    fn listed(&self) -> Listed {
        let element = self.stored.as_ref().map_or_else(Clone::clone, Stored::name);
        Listed { path: self.path.clone(), shape: self.set.shape().to_vec(), element }
    }
}

impl Tree {
    pub(super) fn of(file: &File) -> Result<Self> {
        let root = file.hdf.root_group().map_err(|error| file.refusal("the root group", &error))?;
        let mut tree = Self {
            groups: Vec::new(),
            sets: Vec::new(),
            links: Vec::new(),
            hidden: HashMap::new(),
            unread: Vec::new(),
            is_cut: false,
        };
        let mut seen = HashMap::from([(root.address(), "/".into())]);
        tree.walk(file, &root, "/", 0, &mut seen);
        Ok(tree)
    }

    fn walk(&mut self, file: &File, group: &Group, path: &str, level: usize, seen: &mut HashMap<u64, String>) {
        let found = group.attributes();
        let found = if self.hides(file, &found, Some(group.address())) { group.attributes() } else { found };
        let mut attributes = found.unwrap_or_default();
        attributes.extend(self.hidden.get(&group.address()).into_iter().flat_map(|hidden| hidden.attributes.clone()));
        self.groups.push(GroupEntry { path: path.into(), attributes });
        let links = match links_of(file, group.address()) {
            Ok(links) => links,
            Err(error) => {
                self.unread.push((path.into(), file.refusal(&format!("the group {path}"), &error)));
                return;
            }
        };
        let mut groups = Vec::new();
        for Link { name, object, other_file, .. } in links {
            let path = join(path, &name);
            if self.is_full() {
                return;
            }
            if let Some(other) = other_file {
                let advice = "pass that as the input";
                let feature = format!("{path}, a link to another file ({other}),");
                self.unread.push((path, ImportError::unsupported_but(&file.path, feature, advice)));
                continue;
            }
            let found = group.dataset(&name);
            let found = if self.hides(file, &found, object) { group.dataset(&name) } else { found };
            match found {
                Ok(set) => {
                    let is_link = seen.insert(set.address(), path.clone()).is_some();
                    self.add(path, set, is_link);
                }
                // No dataset: a group, a datatype, or a link to nothing.
                Err(Error::DatasetNotFound(_)) => match group.group(&name) {
                    Ok(group) => groups.push((path, group)),
                    Err(Error::GroupNotFound(_)) => {}
                    Err(error) => self.unread.push((path.clone(), file.refusal(&path, &error))),
                },
                Err(error) => self.unread.push((path.clone(), file.refusal(&path, &error))),
            }
        }
        for (path, group) in groups {
            if self.is_full() || level == MOST_LEVELS {
                self.is_cut = true;
                return;
            }
            if is_coarse_level(&path) {
                continue;
            }
            match seen.get(&group.address()) {
                Some(walked) => self.links.push((path, walked.clone())),
                None => {
                    seen.insert(group.address(), path.clone());
                    self.walk(file, &group, &path, level + 1, seen);
                }
            }
        }
    }

    fn add(&mut self, path: String, set: Dataset, is_link: bool) {
        let (mut attributes, stored, mut unread) = (set.attributes(), Stored::of(&set), Vec::new());
        if let Some(hidden) = self.hidden.get(&set.address()) {
            attributes.extend(hidden.attributes.iter().cloned());
            unread.clone_from(&hidden.unread);
        }
        self.sets.push(Entry { path, set, attributes, stored, unread, is_link });
    }

    /// Whether an object failed by an attribute of a committed datatype, and is read without it from now on.
    fn hides<T>(&mut self, file: &File, found: &Result<T, Error>, object: Option<u64>) -> bool {
        let (Err(error), Some(object)) = (found, object) else { return false };
        if !committed::is_cause(error) || self.hidden.contains_key(&object) {
            return false;
        }
        let hidden = committed::hide(file, object);
        hidden.is_ok_and(|hidden| self.hidden.insert(object, hidden).is_none())
    }

    fn is_full(&mut self) -> bool {
        let count = self.sets.len() + self.groups.len() + self.links.len() + self.unread.len();
        self.is_cut |= count >= MOST_OBJECTS;
        self.is_cut
    }

    /// Whether all of the file was walked.
    pub(super) fn is_whole(&self) -> bool {
        !self.is_cut
    }

    pub(super) fn set(&self, path: &str) -> Option<&Entry> {
        let of = |path: &str| self.sets.iter().find(|entry| entry.path == path);
        of(path).or_else(|| of(&self.walked(path)?))
    }

    pub(super) fn group(&self, path: &str) -> Option<&GroupEntry> {
        let of = |path: &str| self.groups.iter().find(|entry| entry.path == path);
        of(path).or_else(|| of(&self.walked(path)?))
    }

    /// Paths of the groups in a group.
    pub(super) fn groups_in(&self, path: &str) -> impl Iterator<Item = &str> {
        let inside = self.group(path).map(|group| &*group.path);
        self.groups.iter().map(|group| &*group.path).filter(move |path| inside == Some(parent_of(path)))
    }

    /// The path under which an object was walked, of one behind links to groups.
    fn walked(&self, path: &str) -> Option<String> {
        let mut found: Option<String> = None;
        for _ in 0..MOST_LEVELS {
            let path = found.as_deref().unwrap_or(path);
            let behind = |link: &str| path.strip_prefix(link).filter(|rest| rest.is_empty() || rest.starts_with('/'));
            let next = self.links.iter().find_map(|(link, walked)| Some((walked, behind(link)?)));
            let Some((walked, rest)) = next else { break };
            found = Some(if rest.is_empty() { walked.clone() } else { join(walked, rest.trim_start_matches('/')) });
        }
        found
    }

    /// Adds a dataset of this path, which the parser may find by its name in a group that it cannot list.
    pub(super) fn adopt(&mut self, file: &File, name: &str) {
        let path = join("", name.trim_matches('/'));
        if let Ok(set) = file.hdf.dataset(&path)
            && self.sets.iter().all(|entry| entry.set.address() != set.address())
        {
            self.add(path, set, false);
        }
    }

    /// The dataset named by the user, by its path or by a name borne by no other.
    pub(super) fn named(&self, file: &File, name: &str) -> Result<&Entry> {
        let path = join("", name.trim_matches('/'));
        if let Some(entry) = self.set(&path) {
            return Ok(entry);
        }
        // A second link to a dataset.
        if let Ok(set) = file.hdf.dataset(&path)
            && let Some(entry) = self.sets.iter().find(|entry| entry.set.address() == set.address())
        {
            return Ok(entry);
        }
        // An object that cannot be read hides its siblings.
        let hides = |unread: &str| unread == path || unread == "/" || path.starts_with(&join(unread, ""));
        if let Some(place) = self.unread.iter().position(|(unread, _)| hides(unread)) {
            return Err(self.problem_of(place));
        }
        if self.group(&path).is_some() {
            if let Some(entry) = self.signal_of(&path) {
                return Ok(entry);
            }
            let group = self.group(&path).map_or(&*path, |group| &group.path);
            let inside = self.sets.iter().filter(|entry| entry.path.starts_with(&join(group, "")));
            let inside: Vec<Listed> = inside.map(Entry::listed).collect();
            let problem = format!("`variable` {path}: is a group; name a dataset in it: {}", listed(&inside));
            return Err(ImportError::options(&file.path, problem));
        }
        let alike: Vec<&Entry> = self.alike(name).collect();
        match &alike[..] {
            [] => Err(no_such(&file.path, name, self.listed_sets().map(Entry::listed).collect(), &self.rest())),
            [first] => Ok(first),
            alike => Err(ambiguous(&file.path, name, &alike.iter().map(|entry| entry.listed()).collect::<Vec<_>>())),
        }
    }

    /// Datasets of this name in any group, each once.
    fn alike(&self, name: &str) -> impl Iterator<Item = &Entry> {
        let is_name = !name.contains('/');
        let mut seen = HashSet::new();
        let end = format!("/{name}");
        let alike = self.sets.iter().filter(move |entry| is_name && entry.path.ends_with(&end));
        alike.filter(move |entry| seen.insert(entry.set.address()))
    }

    /// Tells which dataset a name chose, if the file has others: by a part of its path, or of several with this name.
    pub(super) fn note_on(&self, entry: &Entry, name: &str) -> Option<Note> {
        let is_whole = join("", name.trim_matches('/')) == entry.path;
        let is_choice = !is_whole || self.alike(name).count() > 1;
        let has_others = self.sets.iter().any(|other| other.is_volume() && other.set.address() != entry.set.address());
        (is_choice && has_others).then(|| Note::new(format!("`variable` {name} is the dataset {}.", entry.path)))
    }

    /// The dataset that the file means, or its only volume; `true` for the latter.
    pub(super) fn chosen(&self, file: &File) -> Result<(&Entry, bool)> {
        if let Some(entry) = self.default_signal() {
            return Ok((entry, false));
        }
        let helpers = self.helpers();
        let volumes: Vec<&Entry> =
            self.listed_sets().filter(|entry| entry.is_volume() && !helpers.contains(&entry.path)).collect();
        match &volumes[..] {
            // What cannot be read may be a volume, too.
            [entry] if !self.is_cut && self.unread.is_empty() => Ok((entry, true)),
            [] if !self.unread.is_empty() => Err(self.problem_of(0)),
            [] => Err(none(&file.path, &self.listed_sets().map(Entry::listed).collect::<Vec<_>>(), &self.rest())),
            volumes => {
                let volumes: Vec<Listed> = volumes.iter().map(|entry| entry.listed()).collect();
                Err(several(&file.path, &volumes, &self.rest()))
            }
        }
    }

    /// Datasets, each once.
    fn listed_sets(&self) -> impl Iterator<Item = &Entry> {
        self.sets.iter().filter(|entry| !entry.is_link)
    }

    /// Datasets that others name as their bounds, coordinates and the like (NetCDF's CF conventions).
    fn helpers(&self) -> HashSet<String> {
        let of = |entry: &Entry| {
            let group = parent_of(&entry.path);
            helpers_of(&entry.attributes[..]).into_iter().map(|name| join(group, &name)).collect::<Vec<_>>()
        };
        self.sets.iter().flat_map(of).collect()
    }

    /// The plot that a NeXus file opens with: from `default` to `default`, or its only one.
    fn default_signal(&self) -> Option<&Entry> {
        let mut path = "/".to_string();
        for _ in 0..8 {
            if let Some(entry) = self.signal_of(&path) {
                return Some(entry);
            }
            let Some(next) = self.group(&path).and_then(|group| text(&group.attributes, "default")) else { break };
            path = join(&path, next.trim_matches('/'));
        }
        let is_data = |group: &&GroupEntry| text(&group.attributes, "NX_class").is_some_and(|class| class == "NXdata");
        let mut plots = self.groups.iter().filter(is_data).filter_map(|group| self.signal_of(&group.path));
        let first = plots.next()?;
        plots.all(|plot| plot.set.address() == first.set.address()).then_some(first)
    }

    /// The dataset that a group's `signal` names, or that says so itself, as old files have it.
    fn signal_of(&self, group: &str) -> Option<&Entry> {
        let signal = text(&self.group(group)?.attributes, "signal");
        let found = match signal {
            Some(name) => self.set(&join(group, &name)),
            None => self.sets.iter().find(|entry| {
                let says = number(&entry.attributes, "signal") == Some(1.0)
                    || texts(&entry.attributes, "signal").first().is_some_and(|text| text == "1");
                parent_of(&entry.path) == self.group(group).map_or(group, |group| &group.path) && says
            }),
        };
        found.filter(|entry| entry.is_volume())
    }

    fn problem_of(&self, place: usize) -> ImportError {
        // Errors are not cloned: their parts are.
        match &self.unread[place].1 {
            ImportError::Unsupported { path, feature, advice } => {
                ImportError::Unsupported { path: path.clone(), feature: feature.clone(), advice: advice.clone() }
            }
            ImportError::Invalid { path, problem } => {
                ImportError::Invalid { path: path.clone(), problem: problem.clone() }
            }
            other => ImportError::invalid(std::path::Path::new(&self.unread[place].0), other.to_string()),
        }
    }

    /// The end of a list: what is not in it.
    fn rest(&self) -> String {
        let mut rest = String::new();
        if let Some((path, _)) = self.unread.first() {
            rest += &format!("; {} cannot be read", if path == "/" { "some of the root group" } else { path });
        }
        if self.is_cut {
            rest += "; and more, not looked at";
        }
        rest
    }
}
