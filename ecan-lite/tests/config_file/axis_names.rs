//! Names of the axes of a file.

use super::network_files::{GATEWAY, directory};
use ecan_lite::config::{load_axes, load_axis_names};

fn names(text: &str) -> Vec<Option<String>> {
    let directory = directory(&[("cell.toml", &format!("{GATEWAY}{text}"))]);
    load_axis_names(directory.path().join("cell.toml")).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn axes_have_the_names_of_their_nodes() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/network/machine.toml");
    let names = load_axis_names(path).unwrap();
    assert_eq!(names, [Some("shoulder".to_owned()), Some("elbow".to_owned())]);
    let nodes: Vec<_> =
        load_axes(path).unwrap().iter().map(|axis| axis.address.node.get()).collect();
    assert_eq!(nodes, [1, 2], "in the same order; the gripper is no axis");
}

#[test]
fn axis_without_a_named_node_has_no_name() {
    let text = "[[axis]]\ngateway = 0\nchannel = 0\nnode = 3\n\
                [[node]]\ngateway = 0\nchannel = 0\nnode = 4\n[node.axis]\nsteps_per_turn = 4096\n\
                [[node]]\nname = \"z\"\ngateway = 0\nchannel = 0\nnode = 5\n[node.axis]\n";
    assert_eq!(names(text), [None, None, Some("z".to_owned())]);
    let text = load_axis_names("/none/cell.toml").unwrap_err().to_string();
    assert!(text.starts_with("cannot read "), "{text}");
}

#[test]
fn axes_of_a_node_have_its_name_and_their_number() {
    let text = "[[node]]\nname = \"gantry\"\ngateway = 0\nchannel = 0\nnode = 3\n\
                [[node.axis]]\n[[node.axis]]\nnode_axis = 2\npdo_number = 2\n\
                [[node]]\ngateway = 0\nchannel = 0\nnode = 4\n\
                [[node.axis]]\n[[node.axis]]\npdo_number = 2\n";
    let name = |name: &str| Some(name.to_owned());
    assert_eq!(names(text), [name("gantry/0"), name("gantry/2"), None, None]);
}
