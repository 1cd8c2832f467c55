//! The benchmark of the cut runs, on a small volume: no figures are judged here.

use std::process::Command;

#[test]
fn cuts_are_measured_from_end_to_end() {
    let arguments = ["--extent", "512", "--slots", "60,100", "--views", "3"];
    let output = Command::new(env!("CARGO_BIN_EXE_cut")).args(arguments).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let cases = result["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 6);
    for case in cases {
        let cells = case["cells"].as_f64().unwrap();
        assert!(cells > 0.0 && cells <= case["slots"].as_f64().unwrap() * 0.9, "{case}");
    }
}
