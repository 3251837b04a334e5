//! The JSON of a specification, as ONNX files hold it.

#![no_main]

use bake_runtime::network::parse_spec;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|json: &str| {
    let Ok(spec) = parse_spec(json) else {
        return;
    };
    let again = serde_json::to_string(&spec).expect("a specification is plain data");
    assert_eq!(parse_spec(&again).as_ref(), Ok(&spec));
    assert_eq!(spec.layers().len(), spec.hidden.len() + 1);
    assert!(spec.parameters() > 0 && spec.macs() < spec.parameters());
});
