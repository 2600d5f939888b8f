//! Named links and joints arranged as a tree: order, parents, mimic joints; a graph that is no tree is refused.

use super::fault::{ModelFault, nearest};
use super::joint::{Drive, Joint, Mimic};
use super::model::{Link, Robot};
use super::step::Step;
use std::collections::HashMap;

type Result<T> = core::result::Result<T, ModelFault>;

/// A joint as the file has it: links and mimicked joint by name.
pub(super) struct NamedJoint {
    pub joint: Joint,
    pub parent: String,
    pub child: String,
    /// Name of the joint that it mimics, multiplier, offset.
    pub mimic: Option<(String, f64, f64)>,
}

fn by_name<'a>(kind: &'static str, names: impl Iterator<Item = &'a str>) -> Result<HashMap<String, usize>> {
    let mut index = HashMap::new();
    for (i, name) in names.enumerate() {
        if index.insert(name.to_owned(), i).is_some() {
            return Err(ModelFault::DuplicateName { kind, name: name.to_owned() });
        }
    }
    Ok(index)
}

/// Which file joints are children of each file link, and which one carries it.
struct Edges {
    above: Vec<Option<usize>>,
    below: Vec<Vec<usize>>,
    parents: Vec<usize>,
    children: Vec<usize>,
}

fn edges(links: &[Link], joints: &[NamedJoint]) -> Result<Edges> {
    let index = by_name("link", links.iter().map(|l| l.name.as_str()))?;
    let find = |joint: &NamedJoint, role: &'static str, link: &str| {
        index.get(link).copied().ok_or_else(|| ModelFault::UnknownLink {
            joint: joint.joint.name.clone(),
            role,
            link: link.to_owned(),
            nearest: nearest(link, links.iter().map(|l| l.name.as_str())),
        })
    };
    let mut edges = Edges {
        above: vec![None; links.len()],
        below: vec![Vec::new(); links.len()],
        parents: Vec::with_capacity(joints.len()),
        children: Vec::with_capacity(joints.len()),
    };
    for (j, joint) in joints.iter().enumerate() {
        let (parent, child) = (find(joint, "parent", &joint.parent)?, find(joint, "child", &joint.child)?);
        if let Some(first) = edges.above[child] {
            return Err(ModelFault::TwoParents {
                link: links[child].name.clone(),
                first: joints[first].joint.name.clone(),
                second: joint.joint.name.clone(),
            });
        }
        edges.above[child] = Some(j);
        edges.below[parent].push(j);
        edges.parents.push(parent);
        edges.children.push(child);
    }
    Ok(edges)
}

/// The loop of joints above a link that no root reaches.
fn loop_above(link: usize, edges: &Edges, joints: &[NamedJoint]) -> ModelFault {
    let mut order = vec![usize::MAX; edges.above.len()];
    let mut path = Vec::new();
    let mut at = link;
    while let Some(j) = edges.above[at] {
        if order[at] != usize::MAX {
            path.drain(..order[at]);
            break;
        }
        order[at] = path.len();
        path.push(j);
        at = edges.parents[j];
    }
    path.reverse();
    ModelFault::Loop { joints: path.into_iter().map(|j| joints[j].joint.name.clone()).collect() }
}

/// File joints in depth-first order (in the order of the file where several are children of one link).
fn depth_first(links: &[Link], joints: &[NamedJoint], edges: &Edges) -> Result<(usize, Vec<usize>)> {
    let mut roots = (0..links.len()).filter(|&l| edges.above[l].is_none());
    let root = match (roots.next(), roots.next()) {
        (None, _) => {
            return Err(if links.is_empty() { ModelFault::NoLinks } else { loop_above(0, edges, joints) });
        }
        (Some(root), None) => root,
        (Some(_), Some(_)) => {
            let all = (0..links.len()).filter(|&l| edges.above[l].is_none());
            return Err(ModelFault::SeveralRoots { roots: all.map(|l| links[l].name.clone()).collect() });
        }
    };
    let mut order = Vec::with_capacity(joints.len());
    let mut reached = vec![false; links.len()];
    reached[root] = true;
    let mut waiting: Vec<usize> = edges.below[root].iter().rev().copied().collect();
    while let Some(j) = waiting.pop() {
        order.push(j);
        reached[edges.children[j]] = true;
        waiting.extend(edges.below[edges.children[j]].iter().rev());
    }
    match reached.iter().position(|r| !r) {
        Some(lost) => Err(loop_above(lost, edges, joints)),
        None => Ok((root, order)),
    }
}

/// The joint that moves a joint by itself, multiplier and offset, for each joint: chains of `<mimic>` tags are followed
/// once, in time linear in the number of joints.
fn drivers(mimics: &[Option<Mimic>], name: &dyn Fn(usize) -> String) -> Result<Vec<(usize, f64, f64)>> {
    let mut known: Vec<Option<(usize, f64, f64)>> =
        mimics.iter().enumerate().map(|(j, mimic)| mimic.is_none().then_some((j, 1.0, 0.0))).collect();
    // Which walk has passed a joint: a walk that meets itself is a circle.
    let mut passed_by = vec![usize::MAX; mimics.len()];
    for start in 0..mimics.len() {
        let mut path: Vec<(usize, Mimic)> = Vec::new();
        let mut at = start;
        let (mut driver, mut multiplier, mut offset) = loop {
            match (known[at], mimics[at]) {
                (Some(found), _) => break found,
                (None, Some(mimic)) => {
                    if passed_by[at] == start {
                        let first = path.iter().position(|&(j, _)| j == at).unwrap_or(0);
                        return Err(ModelFault::MimicCycle {
                            joints: path[first..].iter().map(|&(j, _)| name(j)).collect(),
                        });
                    }
                    passed_by[at] = start;
                    path.push((at, mimic));
                    at = mimic.joint;
                }
                (None, None) => break (at, 1.0, 0.0),
            }
        };
        for (j, mimic) in path.into_iter().rev() {
            (driver, multiplier, offset) =
                (driver, mimic.multiplier * multiplier, mimic.multiplier * offset + mimic.offset);
            known[j] = Some((driver, multiplier, offset));
        }
    }
    Ok(known.into_iter().enumerate().map(|(j, found)| found.unwrap_or((j, 1.0, 0.0))).collect())
}

/// Grows the tree.
///
/// # Errors
/// Duplicate names, unknown links, two parents, several roots, loops, wrong mimic joints.
pub(super) fn grow(name: String, links: Vec<Link>, joints: Vec<NamedJoint>) -> Result<Robot> {
    by_name("joint", joints.iter().map(|j| j.joint.name.as_str()))?;
    let edges = edges(&links, &joints)?;
    let (root, order) = depth_first(&links, &joints, &edges)?;

    // New index of each file link: the root first, then the child of each joint in order.
    let mut place = vec![0; links.len()];
    for (j, &file_joint) in order.iter().enumerate() {
        place[edges.children[file_joint]] = j + 1;
    }
    let mut new_links = vec![links[root].clone()];
    let mut new_joints = Vec::with_capacity(joints.len());
    for (j, &file_joint) in order.iter().enumerate() {
        new_links.push(Link { parent_joint: Some(j), ..links[edges.children[file_joint]].clone() });
        let mut joint = joints[file_joint].joint.clone();
        joint.parent_link = place[edges.parents[file_joint]];
        joint.child_link = j + 1;
        new_joints.push(joint);
    }
    let joint_by_name = by_name("joint", new_joints.iter().map(|j| j.name.as_str()))?;
    let link_by_name = by_name("link", new_links.iter().map(|l| l.name.as_str()))?;

    let mut mimics = vec![None; new_joints.len()];
    for (j, &file_joint) in order.iter().enumerate() {
        let Some((mimicked, multiplier, offset)) = &joints[file_joint].mimic else { continue };
        let fault = |reason| ModelFault::MimicTarget {
            joint: new_joints[j].name.clone(),
            mimicked: mimicked.clone(),
            reason,
            nearest: nearest(mimicked, new_joints.iter().filter(|j| j.kind.moves()).map(|j| j.name.as_str())),
        };
        let joint = *joint_by_name.get(mimicked).ok_or_else(|| fault("does not exist"))?;
        if !new_joints[joint].kind.moves() {
            return Err(fault("is fixed"));
        }
        mimics[j] = Some(Mimic { joint, multiplier: *multiplier, offset: *offset });
    }
    let mut position_of = vec![usize::MAX; new_joints.len()];
    let mut position_joints = Vec::new();
    for (j, joint) in new_joints.iter().enumerate() {
        if joint.kind.moves() && mimics[j].is_none() {
            position_of[j] = position_joints.len();
            position_joints.push(j);
        }
    }
    let drivers = drivers(&mimics, &|j| new_joints[j].name.clone())?;
    for (j, &(driver, multiplier, offset)) in drivers.iter().enumerate() {
        if new_joints[j].kind.moves() {
            if !(multiplier.is_finite() && offset.is_finite()) {
                return Err(ModelFault::Number {
                    element: format!("joint {:?}", new_joints[j].name),
                    quantity: "the product of its chained <mimic> tags",
                    got: multiplier.to_string(),
                    needed: "a finite number",
                });
            }
            new_joints[j].mimic = mimics[j];
            new_joints[j].drive = Some(Drive { position: position_of[driver], multiplier, offset });
        }
    }
    let mut subtree_end: Vec<usize> = (1..=new_links.len()).collect();
    for joint in new_joints.iter().rev() {
        subtree_end[joint.parent_link] = subtree_end[joint.parent_link].max(subtree_end[joint.child_link]);
    }
    let steps = Step::of_joints(&new_joints);
    Ok(Robot {
        name,
        links: new_links,
        joints: new_joints,
        subtree_end,
        position_joints,
        link_by_name,
        joint_by_name,
        steps,
    })
}
