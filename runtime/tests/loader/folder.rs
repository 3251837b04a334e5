//! Networks on disk: three that do not belong together, and what is said of one that is not sound.

use crate::file::File;
use bake_runtime::{BakedMaterial, Error, Network, Role};
use serde_json::json;

#[test]
fn networks_of_different_materials_or_charts() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let write = |role: Role, file: &File| {
        let path = folder.path().join(role.name()).with_extension("safetensors");
        std::fs::write(path, file.bytes()).expect("a temporary folder can be written");
    };
    let refused = |role: Role, spoil: &dyn Fn(&mut serde_json::Value), reason: &str| {
        for role in Role::ALL {
            write(role, &File::sound(role));
        }
        BakedMaterial::load(folder.path()).expect("they belong together");
        let mut spec = File::sound(role).spec;
        spoil(&mut spec);
        write(role, &File::of(spec));
        match BakedMaterial::load(folder.path()) {
            Err(error @ Error::Network { .. }) => {
                let shown = error.to_string();
                assert!(shown.contains(role.name()) && shown.contains(reason), "{shown}");
            }
            other => panic!("{reason}: {other:?}"),
        }
    };
    for role in [Role::Eval, Role::Pdf] {
        refused(
            role,
            &|spec| spec["material"]["name"] = json!("foot"),
            "another material",
        );
    }
    refused(
        Role::Pdf,
        &|spec| spec["geometry"] = json!("disk"),
        "another number of charts",
    );
}

#[test]
fn errors_stay_on_one_line_whatever_they_quote() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("pdf.safetensors");
    let key = "red\u{1b}[31m\nnext";
    let mut file = File::sound(Role::Pdf);
    file.spec["material"][key] = json!(1);
    std::fs::write(&path, file.bytes()).expect("a temporary folder can be written");
    let error = Network::load(&path)
        .expect_err("it has no such parameter")
        .to_string();
    assert!(!error.contains(char::is_control), "{error:?}");
    assert!(
        error.contains("red\\u{1b}[31m\\nnext") && error.contains("unknown field"),
        "{error}"
    );
}
