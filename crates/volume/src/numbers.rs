//! Numbers as text: with as many digits as needed, and a power of ten where it is shorter.

/// Rounds a number to a multiple of a power of ten, `10^place`, without trailing zeros.
pub fn to_place(number: f64, place: i32) -> String {
    if !number.is_finite() {
        return number.to_string();
    }
    let size = number.abs().log10().floor();
    // A number below the place becomes 0 or one of it.
    let rounded = match size >= f64::from(place) {
        true => format!("{number:.*e}", (size - f64::from(place)).min(16.0) as usize).parse().unwrap_or(number),
        false => format!("{}e{place}", (number / 10f64.powi(place)).round()).parse().unwrap_or(number),
    };
    written(rounded.to_string(), format!("{rounded:e}"), rounded)
}

/// Formats a number with this many significant digits.
pub fn significant(number: f64, digits: i32) -> String {
    to_place(number, place_of(number) - digits + 1)
}

/// Formats a value with digits for a thousandth of `span`, wherever the span lies; whole numbers are not rounded. Without a span, with four digits.
pub fn within_span(value: f64, span: f64) -> String {
    let reach = if span.is_finite() && span > 0.0 { span } else { value };
    to_place(value, (place_of(reach) - 3).min(0))
}

/// Formats a number with the fewest digits that read back as the same; with `is_f32` as a 32-bit one, which needs fewer.
pub fn exact(number: f64, is_f32: bool) -> String {
    match is_f32 {
        true => written((number as f32).to_string(), format!("{:e}", number as f32), number),
        false => written(number.to_string(), format!("{number:e}"), number),
    }
}

/// Formats bytes in MiB, rounded up to a tenth; as KiB where they are few.
pub fn mebibytes(bytes: u64) -> String {
    let (unit_bytes, unit) = if bytes < 1 << 20 { (1 << 10, "KiB") } else { (1 << 20, "MiB") };
    let tenths = (u128::from(bytes) * 10).div_ceil(unit_bytes) as f64;
    format!("{} {unit}", tenths / 10.0)
}

/// The power of ten of a number's first digit.
fn place_of(number: f64) -> i32 {
    let power = number.abs().log10().floor();
    if power.is_finite() { power as i32 } else { 0 }
}

/// Chooses the power of ten for very large or small numbers, if it is shorter.
fn written(plain: String, by_power: String, number: f64) -> String {
    let is_usual = (1e-4..1e7).contains(&number.abs());
    match number == 0.0 {
        true => "0".into(),
        false if !is_usual && number.is_finite() && by_power.len() < plain.len() => by_power,
        false => plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_never_less_than_they_are() {
        let found = [0, 1, 1024, (1 << 20) - 1, 1 << 20, 4_419_072, 3 << 30].map(mebibytes);
        assert_eq!(found, ["0 KiB", "0.1 KiB", "1 KiB", "1024 KiB", "1 MiB", "4.3 MiB", "3072 MiB"]);
    }

    #[test]
    fn numbers_have_few_digits() {
        for (number, expected) in [
            (123.456, "123.5"),
            (-0.0123456, "-0.01235"),
            (0.0, "0"),
            (-0.0, "0"),
            (7.0, "7"),
            (9.99996, "10"),
            (12_345_678.0, "1.235e7"),
            (1.5e-7, "1.5e-7"),
            (4.834_321e-7, "4.834e-7"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(significant(number, 4), expected);
        }
    }

    #[test]
    fn values_have_the_digits_that_tell_a_thousandth_of_their_span_apart() {
        for (value, span, expected) in [
            (0.5, 1.0, "0.5"),
            (0.12345, 1.0, "0.123"),
            (127.46, 255.0, "127.5"),
            (1504.4, 65535.0, "1504"),
            (-0.0, 65535.0, "0"),
            (0.000_1, 255.0, "0"),
            (0.06, 255.0, "0.1"),
            (100.0, 65535.0, "100"),
            (0.000_012_34, 1e-5, "1.234e-5"),
            (0.000_000_012_34, 1e-8, "1.234e-8"),
            (1.5e12, 1e12, "1.5e12"),
            (0.25, 0.0, "0.25"),
            (1_000_001_408.0, 4000.0, "1000001408"),
            (999_998_528.0, 4000.0, "999998528"),
            (1e9 + 0.25, 1.0, "1000000000.25"),
            (-3.97e-7, 1.7e-6, "-3.97e-7"),
        ] {
            assert_eq!(within_span(value, span), expected);
        }
        for offset in [0.0, 1e9, -1e12, 1e-6] {
            let texts = [0.0, 1.0, 2.0].map(|step| within_span(offset + 4e3 * step, 4e3));
            assert!(texts[0] != texts[1] && texts[1] != texts[2], "{texts:?}");
        }
    }

    #[test]
    fn exact_numbers_read_back() {
        assert_eq!(exact(f64::from(-5.995_736e-7f32), true), "-5.995736e-7");
        assert_eq!(exact(f64::from(0.1f32), true), "0.1");
        for number in [1.0 / 3.0, -2.5e-9, 65_535.0, 1e300, 0.0, f64::MIN_POSITIVE, f64::INFINITY] {
            assert_eq!(exact(number, false).parse(), Ok(number));
        }
    }
}
