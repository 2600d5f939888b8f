//! URDF text: what loads, what is refused and by which name, and that nothing panics.

use crate::robot_kinematics::random_urdf;
use mirror_core::Error;
use mirror_core::robot::{JointKind, ModelFault, Robot};
use proptest::prelude::*;
use std::path::Path;

fn fault(body: &str) -> ModelFault {
    match Robot::from_urdf_str(&format!("<robot name=\"r\">{body}</robot>")) {
        Err(Error::Robot(fault)) => fault,
        other => panic!("needed a fault, got {other:?}"),
    }
}

const LINKS: &str = "<link name=\"a\"/><link name=\"b\"/><link name=\"c\"/>";

fn joint(name: &str, kind: &str, parent: &str, child: &str, inside: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>{inside}</joint>"
    )
}

fn tree(first: &str, second: &str) -> String {
    format!(
        "{LINKS}{}{}",
        joint("j1", "revolute", "a", "b", first),
        joint("j2", "revolute", "b", "c", second)
    )
}

#[test]
fn real_life_tags_are_no_obstacle() {
    let robot = Robot::from_urdf_str(
        r#"<?xml version="1.0" encoding="utf-8"?>
        <!-- made by hand --> <!DOCTYPE robot>
        <robot name="r" xmlns:xacro="http://ros.org/wiki/xacro">
          <xacro:property name="pi" value="${acos(-1)}"/>
          <material name="red"><color rgba="1 0"/></material>
          <link name="a"><visual><geometry><mesh/></geometry><material/></visual><collision><geometry/></collision></link>
          <link name="b"><!-- no inertia tensor --><inertial><mass value="2"/><origin xyz="1 2 3"/></inertial></link>
          <joint name="j" type="continuous">
            <parent link="a"/><child link="b"/><axis xyz="0 0 2"/><limit effort="3"/><dynamics damping="x"/>
            <safety_controller/><sensor:foo/>
          </joint>
          <transmission name="t"><joint name="j"/><type>x</type></transmission>
          <gazebo reference="a"><link name="z"/></gazebo><ros2_control><joint name="q"/></ros2_control>
        </robot>"#,
    )
    .unwrap();
    assert_eq!(robot.links().len(), 2);
    assert_eq!((robot.links()[0].mass_kg, robot.links()[1].mass_kg), (0.0, 2.0));
    assert_eq!(robot.joints()[0].kind, JointKind::Continuous);
    assert_eq!(robot.joints()[0].axis.z, 1.0);
}

#[test]
fn the_order_is_depth_first_and_names_are_found() {
    let robot = Robot::from_urdf_str(&random_urdf(5, 30)).unwrap();
    for (j, joint) in robot.joints().iter().enumerate() {
        assert_eq!(joint.child_link, j + 1);
        assert!(joint.parent_link <= j);
        assert_eq!(robot.links()[j + 1].parent_joint, Some(j));
        assert_eq!(robot.joint_index(&joint.name).unwrap(), j);
    }
    for (k, name) in robot.position_names().enumerate() {
        assert_eq!(robot.position_index(name).unwrap(), k);
    }
    let Err(Error::Robot(ModelFault::UnknownName { nearest, .. })) = robot.link_index("l1O") else {
        panic!()
    };
    assert!(nearest.contains(&"l1".to_owned()) || nearest.contains(&"l10".to_owned()), "{nearest:?}");
}

#[test]
fn what_is_no_tree_is_refused_by_name() {
    let two_parents = tree("", "") + &joint("j3", "fixed", "a", "c", "");
    assert_eq!(
        fault(&two_parents),
        ModelFault::TwoParents { link: "c".into(), first: "j2".into(), second: "j3".into() }
    );
    let circle =
        format!("{LINKS}{}{}", joint("j1", "fixed", "b", "c", ""), joint("j2", "fixed", "c", "b", ""));
    let ModelFault::Loop { joints } = fault(&circle) else { panic!() };
    assert_eq!(joints.len(), 2);
    let whole = joint("j1", "fixed", "a", "b", "") + &joint("j2", "fixed", "b", "a", "");
    let ModelFault::Loop { joints } = fault(&format!("<link name=\"a\"/><link name=\"b\"/>{whole}")) else {
        panic!()
    };
    assert_eq!(joints.len(), 2);
    assert_eq!(
        fault(&format!("{LINKS}{}", joint("j1", "fixed", "a", "b", ""))),
        ModelFault::SeveralRoots { roots: vec!["a".into(), "c".into()] }
    );
    let ModelFault::UnknownLink { joint, role, link, nearest } =
        fault(&format!("{LINKS}{}", joint("j1", "fixed", "a", "bb", "")))
    else {
        panic!()
    };
    assert_eq!((joint.as_str(), role, link.as_str()), ("j1", "child", "bb"));
    assert_eq!(nearest[0], "b");
    assert_eq!(fault(""), ModelFault::NoLinks);
    let twice = format!("{LINKS}<link name=\"a\"/>");
    assert_eq!(fault(&twice), ModelFault::DuplicateName { kind: "link", name: "a".into() });
    let same = tree("", "").replace("j2", "j1");
    assert_eq!(fault(&same), ModelFault::DuplicateName { kind: "joint", name: "j1".into() });
}

#[test]
fn wrong_joints_are_refused_by_name() {
    let ModelFault::ZeroAxis { joint: named, .. } = fault(&tree("", "<axis xyz=\"0 0 0\"/>")) else {
        panic!()
    };
    assert_eq!(named, "j2");
    // A fixed joint's axis is often written as zeros.
    let fixed = tree("", "<axis xyz=\"0 0 0\"/>")
        .replace("name=\"j2\" type=\"revolute\"", "name=\"j2\" type=\"fixed\"");
    assert!(Robot::from_urdf_str(&format!("<robot name=\"r\">{fixed}</robot>")).is_ok());
    for kind in ["floating", "planar", "spherical", "hinge", ""] {
        let body = format!("{LINKS}{}", joint("j1", kind, "a", "b", ""));
        assert_eq!(fault(&body), ModelFault::UnsupportedJoint { joint: "j1".into(), got: kind.into() });
    }
    let ModelFault::MimicTarget { mimicked, nearest, .. } = fault(&tree("", "<mimic joint=\"j\"/>")) else {
        panic!()
    };
    assert_eq!((mimicked.as_str(), nearest.len()), ("j", 2));
    let ModelFault::MimicCycle { joints } = fault(&tree("<mimic joint=\"j2\"/>", "<mimic joint=\"j1\"/>"))
    else {
        panic!()
    };
    assert_eq!(joints.len(), 2);
    let ModelFault::MimicCycle { joints } = fault(&tree("<mimic joint=\"j1\"/>", "")) else { panic!() };
    assert_eq!(joints, ["j1"]);
}

#[test]
fn numbers_that_cannot_be_meant_are_refused_with_their_owner() {
    for bad in [
        "<origin xyz=\"1 2\"/>",
        "<origin xyz=\"1 a 2 3\"/>",
        "<origin rpy=\"0 0 ${pi}\"/>",
        "<origin xyz=\"nan 0 0\"/>",
    ] {
        let ModelFault::Element { element, reason } = fault(&tree("", bad)) else { panic!("{bad}") };
        assert_eq!(element, "joint \"j2\"");
        assert!(bad.contains("${") == reason.contains("xacro"), "{reason}");
    }
    for bad in [
        "<origin xyz=\"inf 0 0\"/>",
        "<origin xyz=\"1e300 0 0\"/>",
        // Millimetres and degrees.
        "<origin xyz=\"0 0 75.5\"/>",
        "<origin rpy=\"0 90 0\"/>",
        "<axis xyz=\"1e308 1e308 0\"/>",
        "<limit lower=\"2\" upper=\"1\"/>",
        "<mimic joint=\"j1\" multiplier=\"inf\"/>",
    ] {
        let ModelFault::Number { element, .. } = fault(&tree("", bad)) else { panic!("{bad}") };
        assert_eq!(element, "joint \"j2\"");
    }
    let heavy = "<link name=\"x\"><inertial><mass value=\"-1\"/></inertial></link>";
    let ModelFault::Number { element, .. } = fault(heavy) else { panic!() };
    assert_eq!(element, "link \"x\"");
}

#[test]
fn what_is_no_urdf_is_refused() {
    for text in
        ["", "hello", "<sdf/>", "<robot>", "<robot></wrong>", "<robot", "{\"robot\": 1}", "<robot/><robot/>"]
    {
        let error = Robot::from_urdf_str(text).unwrap_err();
        assert!(matches!(error, Error::Robot(ModelFault::NotUrdf { .. })), "{text}: {error}");
    }
    let error = Robot::from_urdf_file(Path::new("no/such/robot.urdf")).unwrap_err();
    assert!(error.to_string().contains("no/such/robot.urdf"), "{error}");
}

#[test]
fn depth_beyond_reason_does_not_overflow_the_stack() {
    let deep = format!("<robot name=\"r\"><link name=\"a\">{}", "<inertial>".repeat(200_000));
    assert!(Robot::from_urdf_str(&deep).is_err());
    let closed =
        format!("<robot><link name=\"a\"/>{}{}</robot>", "<x>".repeat(100_000), "</x>".repeat(100_000));
    assert_eq!(Robot::from_urdf_str(&closed).unwrap().links().len(), 1);
    let links: String = (0..5_000).map(|k| format!("<link name=\"l{k}\"/>")).collect();
    let joints: String = (1..5_000)
        .map(|k| joint(&format!("j{k}"), "revolute", &format!("l{}", k - 1), &format!("l{k}"), ""))
        .collect();
    let chain = Robot::from_urdf_str(&format!("<robot>{links}{joints}</robot>")).unwrap();
    assert_eq!(chain.position_count(), 4_999);
}

#[test]
fn a_chain_of_mimic_joints_is_followed_once() {
    let count = 4_000;
    let links: String = (0..=count).map(|k| format!("<link name=\"l{k}\"/>")).collect();
    let joints: String = (0..count)
        .map(|k| {
            let tag = format!("<mimic joint=\"j{}\" multiplier=\"-1\" offset=\"0.5\"/>", k + 1);
            let inside = if k + 1 < count { tag } else { String::new() };
            joint(&format!("j{k}"), "revolute", &format!("l{k}"), &format!("l{}", k + 1), &inside)
        })
        .collect();
    let begun = std::time::Instant::now();
    let robot = Robot::from_urdf_str(&format!("<robot>{links}{joints}</robot>")).unwrap();
    // Quadratic, this took ten seconds; the bound leaves room for a busy machine.
    assert!(begun.elapsed().as_secs_f64() < 5.0, "{:?}", begun.elapsed());
    assert_eq!(robot.position_count(), 1);
    let drive = robot.joints()[0].drive.unwrap();
    // An odd number of reflections about 0.25.
    assert_eq!((drive.position, drive.multiplier, drive.offset), (0, -1.0, 0.5));
    assert_eq!(robot.joints()[1].drive.unwrap().multiplier, 1.0);
}

#[test]
fn more_than_a_robot_has_is_refused_at_once() {
    let many: String = (0..200_000).map(|k| format!(" a{k}=\"1\"")).collect();
    let begun = std::time::Instant::now();
    for text in [
        format!("<robot><link name=\"a\"{many}/></robot>"),
        format!("<robot{many}/>"),
        format!("<robot>{}</robot>", "<link name=\"a\"/>".repeat(20_000)),
        format!("<robot>{}</robot>", " ".repeat(64_000_001)),
    ] {
        let error = Robot::from_urdf_str(&text).unwrap_err();
        assert!(error.to_string().contains("needed"), "{error}");
    }
    assert!(begun.elapsed().as_secs_f64() < 5.0, "{:?}", begun.elapsed());
}

/// Reads text; where it is a robot, its kinematics must be finite.
fn read_and_move(text: &str) {
    if let Ok(robot) = Robot::from_urdf_str(text) {
        let poses = robot.poses(&vec![0.3; robot.position_count()]).unwrap();
        for link in 0..poses.len() {
            let pose = poses.root_from_link(link);
            assert!(pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite()));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn mangled_text_never_panics(
        seed in 0u64..50,
        edits in prop::collection::vec((0.0..1.0f64, 0usize..40, "[ -~\u{e9}\n]{0,8}"), 1..12),
    ) {
        let mut text = random_urdf(seed, 6);
        for (place, cut, paste) in edits {
            let mut start = (place * text.len() as f64) as usize;
            while !text.is_char_boundary(start) { start -= 1; }
            let mut end = (start + cut).min(text.len());
            while !text.is_char_boundary(end) { end += 1; }
            text.replace_range(start..end, &paste);
        }
        read_and_move(&text);
    }

    #[test]
    fn shuffled_words_never_panic(words in prop::collection::vec(
        prop::sample::select(vec![
            "<robot>", "</robot>", "<link name=\"a\">", "</link>", "<link name=\"b\"/>", "<joint name=\"j\" type=\"revolute\">",
            "</joint>", "<parent link=\"a\"/>", "<child link=\"b\"/>", "<inertial>", "</inertial>", "<mass value=\"1e400\"/>",
            "<origin xyz=\"1 2 3\"/>", "<axis xyz=\"0 1e-300 0\"/>", "<mimic joint=\"j\"/>", "<!--", "-->", "&#0;", "<![CDATA[", "]]>",
        ]), 0..25)) {
        read_and_move(&words.concat());
    }
}

/// A joint that is locked elsewhere than at 0 stays there; 0 to 0 is how a missing range reads.
#[test]
fn a_range_of_one_position_holds_the_joint() {
    let limits = |range: &str| {
        let limit = format!("<limit {range} effort=\"1\" velocity=\"1\"/>");
        let robot =
            Robot::from_urdf_str(&format!("<robot name=\"r\">{}</robot>", tree(&limit, &limit))).unwrap();
        robot.joints()[robot.joint_index("j1").unwrap()].limits.map(|l| (l.lower, l.upper))
    };
    assert_eq!(limits("lower=\"0.5\" upper=\"0.5\""), Some((0.5, 0.5)));
    assert_eq!(limits("lower=\"0\" upper=\"0\""), None);
    let endless = r#"<limit lower="inf" upper="inf" effort="1" velocity="1"/>"#;
    assert!(matches!(fault(&tree(endless, "")), ModelFault::Number { quantity: "its range", .. }));
}
