//! Real URDF text reduced to the part that kinematics and gravity need, checked number by number.
//!
//! `urdf-rs` reads pictures, materials and limits strictly, and refuses a whole robot for a mesh without a file
//! name. It also skips words that are not numbers. This filter keeps links, inertials and joints, drops everything
//! else (visuals, collisions, transmissions, simulator and xacro tags, deeper nesting), and refuses what cannot be
//! read, with the name of the link or joint around it.

use super::fault::ModelFault;
use quick_xml::Reader;
use quick_xml::escape::escape;
use quick_xml::events::{BytesStart, Event};
use std::fmt::Write;

/// The required type of an attribute.
enum Holds {
    Text,
    Numbers(usize),
}

/// The attributes that are kept, by the element's place.
fn kept(parent: &str, element: &str) -> Option<&'static [(&'static str, Holds)]> {
    use Holds::{Numbers, Text};
    Some(match (parent, element) {
        (_, "origin") => &[("xyz", Numbers(3)), ("rpy", Numbers(3)), ("quat_xyzw", Numbers(4))],
        ("inertial", "mass") => &[("value", Numbers(1))],
        ("joint", "parent" | "child") => &[("link", Text)],
        ("joint", "axis") => &[("xyz", Numbers(3))],
        ("joint", "limit") => {
            &[("lower", Numbers(1)), ("upper", Numbers(1)), ("effort", Numbers(1)), ("velocity", Numbers(1))]
        }
        ("joint", "mimic") => &[("joint", Text), ("multiplier", Numbers(1)), ("offset", Numbers(1))],
        _ => return None,
    })
}

/// The joint types that are modelled.
const JOINT_TYPES: [&str; 4] = ["revolute", "continuous", "prismatic", "fixed"];

/// Largest size of a URDF text, bytes: the largest known ones, with all their pictures, have a few million.
pub(super) const MOST_BYTES: usize = 64_000_000;
/// Largest number of links and joints together: each posture needs a matrix for every link.
const MOST_PARTS: usize = 10_000;
/// Attributes of one element at most: the parser compares each with all before it.
const MOST_ATTRIBUTES: usize = 100;

/// An attribute by its exact name, its entities resolved.
fn attribute(tag: &BytesStart<'_>, name: &str, at_byte: u64) -> Result<Option<String>, ModelFault> {
    let not_xml = |reason: String| ModelFault::NotUrdf { at_byte, reason };
    for attribute in tag.attributes() {
        let attribute = attribute.map_err(|e| not_xml(e.to_string()))?;
        if attribute.key.as_ref() == name.as_bytes() {
            return attribute
                .unescape_value()
                .map(|v| Some(v.into_owned()))
                .map_err(|e| not_xml(e.to_string()));
        }
    }
    Ok(None)
}

fn numbers(text: &str, count: usize, owner: &str, what: &str) -> Result<(), ModelFault> {
    // Limits may be infinite (no limit), all else is checked for finiteness where it is used.
    let good = text.split_whitespace().all(|word| word.parse::<f64>().is_ok_and(|x| !x.is_nan()));
    if good && text.split_whitespace().count() == count {
        return Ok(());
    }
    let hint = if text.contains("${") {
        "; this is a xacro expression: expand the file with xacro first"
    } else {
        ""
    };
    Err(ModelFault::Element {
        element: owner.to_owned(),
        reason: format!(
            "{what}=\"{text}\", needed {count} number{}{hint}",
            if count == 1 { "" } else { "s" }
        ),
    })
}

/// The walk through the document.
struct Tidy {
    out: String,
    /// Names of the open elements; an element that is dropped, and all below it, is not on the stack.
    open: Vec<String>,
    /// How deep inside a dropped element the walk is.
    dropped: usize,
    /// The link or joint around, for messages.
    owner: String,
    seen: usize,
}

impl Tidy {
    fn start(&mut self, tag: &BytesStart<'_>, at_byte: u64) -> Result<(), ModelFault> {
        if self.dropped > 0 {
            self.dropped += 1;
            return Ok(());
        }
        if tag.attributes().with_checks(false).take(MOST_ATTRIBUTES + 1).count() > MOST_ATTRIBUTES {
            return Err(ModelFault::NotUrdf {
                at_byte,
                reason: format!("an element has more than {MOST_ATTRIBUTES} attributes, needed fewer"),
            });
        }
        let raw = tag.name();
        let name = core::str::from_utf8(raw.as_ref()).unwrap_or_default();
        let parent = self.open.last().map_or("", String::as_str);
        match (self.open.len(), parent, name) {
            (0, _, "robot") => {
                let robot = attribute(tag, "name", at_byte)?.unwrap_or_default();
                let version = attribute(tag, "version", at_byte)?.unwrap_or_else(|| "1.0".to_owned());
                let _ =
                    write!(self.out, "<robot name=\"{}\" version=\"{}\">", escape(robot), escape(version));
            }
            (0, _, other) => {
                return Err(ModelFault::NotUrdf {
                    at_byte,
                    reason: format!("the outermost element is <{other}>, needed <robot>"),
                });
            }
            (1, _, "link" | "joint") => self.part(tag, name, at_byte)?,
            (2, "link", "inertial") => self.out.push_str("<inertial>"),
            (2, "joint", _) | (3, "inertial", _) => match kept(parent, name) {
                Some(attributes) => self.leaf(tag, name, attributes, at_byte)?,
                None => {
                    self.dropped = 1;
                    return Ok(());
                }
            },
            _ => {
                self.dropped = 1;
                return Ok(());
            }
        }
        self.open.push(name.to_owned());
        Ok(())
    }

    /// `<link>` or `<joint>`.
    fn part(&mut self, tag: &BytesStart<'_>, kind: &str, at_byte: u64) -> Result<(), ModelFault> {
        self.seen += 1;
        if self.seen > MOST_PARTS {
            return Err(ModelFault::NotUrdf {
                at_byte,
                reason: format!("there are more than {MOST_PARTS} links and joints, needed a robot of fewer"),
            });
        }
        let name =
            attribute(tag, "name", at_byte)?.filter(|name| !name.trim().is_empty()).ok_or_else(|| {
                ModelFault::Element {
                    element: format!("<{kind}> at byte {at_byte}"),
                    reason: "it has no name, needed name=\"…\"".to_owned(),
                }
            })?;
        self.owner = format!("{kind} {name:?}");
        let _ = write!(self.out, "<{kind} name=\"{}\"", escape(name.as_str()));
        if kind == "joint" {
            let got = attribute(tag, "type", at_byte)?.unwrap_or_default();
            if !JOINT_TYPES.contains(&got.as_str()) {
                return Err(ModelFault::UnsupportedJoint { joint: name, got });
            }
            let _ = write!(self.out, " type=\"{got}\"");
        }
        self.out.push('>');
        Ok(())
    }

    /// An element that only has attributes.
    fn leaf(
        &mut self,
        tag: &BytesStart<'_>,
        name: &str,
        attributes: &[(&str, Holds)],
        at_byte: u64,
    ) -> Result<(), ModelFault> {
        let _ = write!(self.out, "<{name}");
        for (key, holds) in attributes {
            let Some(value) = attribute(tag, key, at_byte)? else {
                // `urdf-rs` insists on the velocity limit, which is of no use here.
                if (name, *key) == ("limit", "velocity") {
                    self.out.push_str(" velocity=\"0\"");
                }
                continue;
            };
            if let Holds::Numbers(count) = holds {
                numbers(&value, *count, &self.owner, &format!("<{name}> {key}"))?;
            }
            let _ = write!(self.out, " {key}=\"{}\"", escape(value));
        }
        self.out.push('>');
        Ok(())
    }

    fn end(&mut self) {
        if self.dropped > 0 {
            self.dropped -= 1;
        } else if let Some(name) = self.open.pop() {
            if name == "inertial" {
                // Rotational inertia has no effect at rest; `urdf-rs` requires one.
                self.out.push_str("<inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/>");
            }
            let _ = write!(self.out, "</{name}>");
        }
    }
}

/// The part of a URDF text that kinematics and gravity need, as URDF text.
///
/// # Errors
/// [`ModelFault::NotUrdf`] where the text is no XML or has another root, [`ModelFault::Element`] where a name is
/// missing or a number cannot be read, [`ModelFault::UnsupportedJoint`].
pub(super) fn tidy(text: &str) -> Result<String, ModelFault> {
    if text.len() > MOST_BYTES {
        return Err(ModelFault::NotUrdf {
            at_byte: MOST_BYTES as u64,
            reason: format!("it has {} bytes, needed at most {MOST_BYTES}", text.len()),
        });
    }
    let mut reader = Reader::from_str(text.trim_start_matches('\u{feff}'));
    let mut walk = Tidy {
        out: String::with_capacity(text.len() / 2),
        open: Vec::new(),
        dropped: 0,
        owner: String::new(),
        seen: 0,
    };
    let mut closed = false;
    loop {
        let at_byte = reader.buffer_position();
        let event =
            reader.read_event().map_err(|e| ModelFault::NotUrdf { at_byte, reason: e.to_string() })?;
        match event {
            Event::Start(_) | Event::Empty(_) if closed => {
                return Err(ModelFault::NotUrdf {
                    at_byte,
                    reason: "there is a second outermost element".to_owned(),
                });
            }
            Event::Start(tag) => walk.start(&tag, at_byte)?,
            Event::Empty(tag) => {
                walk.start(&tag, at_byte)?;
                walk.end();
                closed = walk.open.is_empty();
            }
            Event::End(_) => {
                walk.end();
                closed = walk.open.is_empty();
            }
            Event::Eof if closed => {
                return if walk.seen == 0 { Err(ModelFault::NoLinks) } else { Ok(walk.out) };
            }
            Event::Eof => {
                let reason = match walk.open.last() {
                    Some(name) => format!("the text ends inside <{name}>, needed </{name}>"),
                    None => "there is no XML element, needed <robot>".to_owned(),
                };
                return Err(ModelFault::NotUrdf { at_byte, reason });
            }
            // Comments, text, declarations and processing instructions carry nothing.
            _ => {}
        }
    }
}
