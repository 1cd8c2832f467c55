use super::*;
use proptest::prelude::*;

fn value(text: &str, volumes: &[f64]) -> f64 {
    Expression::parse(text, volumes.len()).unwrap_or_else(|e| panic!("{e}")).value(volumes)
}

#[test]
fn operators_bind_as_everywhere() {
    let at = |text| value(text, &[3.0, 5.0, 0.0]);
    for (text, expected) in [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("2 - 3 - 4", -5.0),
        ("24 / 4 / 2", 3.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("-a ^ 2", -9.0),
        ("2 ^ -1", 0.5),
        ("-2 * -a", 6.0),
        ("!a == 0", 1.0),
        ("a < b == b > a", 1.0),
        ("a <= 3 && b >= 5 || c", 1.0),
        ("a > 3 || b != 5", 0.0),
        ("c ? 1 : a ? 2 : 3", 2.0),
        ("a > 2 ? b : c ? 1 : 2", 5.0),
        ("1.5e1 + .5 + 2. + 1E-1", 17.6),
        ("max(a, b * 0.5)", 3.0),
        ("clamp(b, 0, 4) + mix(a, b, 0.25)", 7.5),
        ("smoothstep(0, 10, b) + step(3, a)", 1.5),
        ("v0 + v1\n+ v2", 8.0),
        ("round(2.5) + floor(-0.5) + ceil(0.5) + sign(-a) + abs(-a)", 4.0),
        ("sqrt(b + 4) + exp(c) + log(1) + sin(c) + cos(pi)", 3.0),
        ("(-2) ^ 3", -8.0),
        ("pow(a, 2)", 9.0),
    ] {
        assert!((at(text) - expected).abs() < 1e-12, "{text}: {}", at(text));
    }
}

#[test]
fn what_is_made_of_no_value_is_none() {
    let at = |text| value(text, &[f64::NAN, 5.0]);
    for text in
        ["a + b", "min(a, b)", "a < b", "!a", "a ? 1 : 2", "b && a", "1 / 0", "log(-b)", "sqrt(-1) * 0", "(-2) ^ 0.5"]
    {
        assert!(at(text).is_nan(), "{text}: {}", at(text));
    }
    for (text, expected) in [
        ("default(a, 7)", 7.0),
        ("default(b, a)", 5.0),
        ("valid(a)", 0.0),
        ("valid(b)", 1.0),
        ("valid(a) ? a : b", 5.0),
    ] {
        assert_eq!(at(text), expected, "{text}");
    }
}

#[test]
fn errors_point_at_the_place() {
    let error = |text: &str| Expression::parse(text, 2).expect_err(text);
    for (text, position, part) in [
        ("", 0, "found the end"),
        ("max(a, *b)", 7, "found '*'"),
        ("max(a b)", 6, "',' and 1 more of max's 2 arguments"),
        ("max(a, b, a)", 8, "')' as max has 2 arguments"),
        ("maxx(a, b)", 0, "unknown name 'maxx'"),
        ("a + c", 4, "there is no volume c: there are 2 volumes, a to b"),
        ("a + v2", 4, "there is no volume v2"),
        ("v99999999999999999999", 0, "there is no volume"),
        ("(a + b", 6, "expected ')', found the end"),
        ("a b", 2, "expected an operator or the end"),
        ("a ? b", 5, "expected ':'"),
        ("1e999", 0, "'1e999' is no number"),
        (".", 0, "'.' is no number"),
        ("a + ü", 4, "found 'ü'"),
        ("ü", 0, "found 'ü'"),
        ("a = b", 2, "found '='"),
        ("a; b", 1, "found ';'"),
    ] {
        let error = error(text);
        assert_eq!(error.position, position, "{text}: {error}");
        assert!(error.problem.contains(part), "{text}: {error}");
    }
    let shown = error("max(a,\t*b)").to_string();
    assert_eq!(shown, "expected a number, a volume, a function or '(', found '*'\n  max(a, *b)\n         ^");
    let deep = "(".repeat(5000);
    assert!(error(&deep).problem.contains("characters"));
    assert!(error(&"(".repeat(1000)).problem.contains("nested"));
    assert!(error(&"-".repeat(1000)).problem.contains("nested"));
    let long = vec!["a"; 100].join("+");
    assert!(error(&long).problem.contains("more than 128 operations"));
}

#[test]
fn it_knows_what_it_reads() {
    let of = |text| Expression::parse(text, 32).unwrap().volumes();
    assert_eq!(of("v31 + b * b"), [1, 31]);
    assert_eq!(of("1"), [0; 0]);
}

/// Expressions of three volumes.
fn texts() -> impl Strategy<Value = String> {
    let leaf =
        prop_oneof![Just("a".to_string()), Just("b".into()), Just("c".into()), (-3..4).prop_map(|n| format!("({n})"))];
    leaf.prop_recursive(4, 24, 3, |inner| {
        let binary = prop::sample::select(vec!["+", "-", "*", "/", "^", "<", "<=", "==", "!=", ">", ">=", "&&", "||"]);
        let unary = prop::sample::select(vec![
            "-", "!", "abs", "sign", "floor", "ceil", "round", "sqrt", "exp", "log", "sin", "cos", "valid",
        ]);
        prop_oneof![
            (inner.clone(), binary, inner.clone()).prop_map(|(x, op, y)| format!("({x} {op} {y})")),
            (unary, inner.clone()).prop_map(|(f, x)| format!("{f}({x})")),
            (prop::sample::select(vec!["min", "max", "default"]), inner.clone(), inner.clone())
                .prop_map(|(f, x, y)| format!("{f}({x}, {y})")),
            (inner.clone(), inner.clone(), inner).prop_map(|(c, x, y)| format!("({c} ? {x} : {y})")),
        ]
    })
}

#[test]
fn gradients_follow_the_chain_rule() {
    let at = DVec3::new(0.3, -0.7, 1.1);
    let fields: [fn(DVec3) -> f64; 2] = [|p| 3.0 + p.dot(DVec3::new(0.5, 1.0, -0.25)), |p| 2.0 + p.x * p.y + p.z];
    let gradients = [DVec3::new(0.5, 1.0, -0.25), DVec3::new(at.y, at.x, 1.0)];
    let values = |p: DVec3| fields.map(|field| field(p));
    for text in [
        "a",
        "-a",
        "a + b",
        "a - 2 * b",
        "a * b",
        "a / b",
        "b ^ 3",
        "2 ^ b",
        "a ^ b",
        "(-a) ^ 2",
        "min(a, b)",
        "max(a, b)",
        "abs(-b)",
        "sqrt(a)",
        "exp(b / 4)",
        "log(a * b)",
        "sin(a) + cos(b)",
        "a > b ? a * a : b",
        "default(log(-a), a * b)",
        "smoothstep(0, 10, a) * b",
        "valid(a) * b + floor(a)",
    ] {
        let expression = Expression::parse(text, 2).unwrap();
        let (value, gradient) = expression.value_and_gradient(&values(at), &gradients);
        let h = 1e-5;
        let difference = |axis: DVec3| {
            let [before, after] = [-h, h].map(|h| expression.value(&values(at + axis * h)));
            (after - before) / (2.0 * h)
        };
        let expected = DVec3::from_array(DVec3::AXES.map(difference));
        // Central differences are off by the third derivative times h^2, and by rounding over h.
        let off = (gradient.expect(text) - expected).length();
        assert!(value == expression.value(&values(at)) && off < 1e-7 * (1.0 + expected.length()), "{text}: {off}");
    }
    for flat in ["a - a", "a < b", "1", "floor(b)", "sqrt(a - 3.625) * 0", "a * 1000 - a * 1000.1"] {
        let (value, gradient) = Expression::parse(flat, 2).unwrap().value_and_gradient(&values(at), &gradients);
        assert_eq!(gradient, None, "{flat} is {value}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn ranges_hold_every_value(
        text in texts(),
        ends in prop::array::uniform3((-4.0f64..4.0, 0.0f64..2.0)),
        shares in prop::array::uniform3(-0.1f64..=1.0),
    ) {
        let expression = Expression::parse(&text, 3).unwrap();
        let ranges = ends.map(|(low, width)| Some([low.round(), low.round() + width]));
        let values: [f64; 3] = std::array::from_fn(|i| {
            // Sometimes without a value, or with an end's.
            let [low, high] = ranges[i].unwrap();
            if shares[i] < -0.05 { f64::NAN } else { low + (high - low) * shares[i].max(0.0) }
        });
        let value = expression.value(&values);
        if !value.is_nan() {
            let range = expression.range(&ranges);
            let Some([low, high]) = range else { panic!("{text} of {values:?} is {value}, and has no range") };
            // Powers and exponentials are rounded, not always the same way.
            let slack = 1e-12 * value.abs();
            prop_assert!(low <= value + slack && value - slack <= high, "{text} of {values:?} is {value}: {range:?}");
        }
    }

    #[test]
    fn no_text_panics(text in "[ -~üa-c0-9+*/(),?:<>=!&|^.-]{0,40}") {
        if let Err(error) = Expression::parse(&text, 2) {
            prop_assert!(error.position <= text.chars().count(), "{error}");
        }
    }
}
