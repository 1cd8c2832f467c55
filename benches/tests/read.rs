//! The benchmark programs run, on small data: no figures are judged here.

use std::process::Command;

#[test]
fn reading_is_measured_from_end_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--extent", "150", "--dtype", "u16", "--repetitions", "2", "--boxes", "8"];
    let output = Command::new(env!("CARGO_BIN_EXE_read")).args(arguments).current_dir(&folder).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let cases = result["cases"].as_array().unwrap();
    assert_eq!(result["bricks"], 27);
    assert_eq!(cases.len(), 10);
    for case in cases {
        assert!(case["per_s"].as_f64().unwrap() > 0.0 && case["of_bare"].as_f64().unwrap() > 0.0, "{case}");
    }
}
