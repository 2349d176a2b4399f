//! Numbers as people read them, for tick labels, readings and summaries.

/// `n` as superscript digits: −3 gives `⁻³`.
pub fn superscript(n: i32) -> String {
    n.to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
        })
        .collect()
}

/// `value` with `digits` significant digits: plain between 0.001 and 99,999, else like `1.2·10⁻⁷`.
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".into() } else { value.to_string().replace("inf", "∞").replace('-', "−") };
    }
    // Rounding first, so that 9.99 with two digits is 10 and not 10.0.
    let scientific = format!("{:.*e}", digits.max(1) - 1, value);
    let (mantissa, exponent) = scientific.split_once('e').expect("the format writes an exponent");
    let exponent: i32 = exponent.parse().expect("the format writes a whole exponent");
    let text = if (-3..5).contains(&exponent) {
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        format!("{:.decimals$}", scientific.parse::<f64>().expect("it was just written"))
    } else {
        format!("{mantissa}·10{}", superscript(exponent))
    };
    text.replace('-', "−")
}

/// `count` with thin groups of three: `1 234 567`.
pub fn grouped(count: i64) -> String {
    let digits = count.unsigned_abs().to_string();
    let mut text = String::from(if count < 0 { "−" } else { "" });
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push('\u{a0}');
        }
        text.push(digit);
    }
    text
}

/// A time: `12 µs`, `3.4 ms`, `2.5 s`, `4 min 10 s`.
pub fn seconds(value: f64) -> String {
    match value {
        v if !v.is_finite() => significant(v, 2),
        v if v < 1e-3 => format!("{} µs", significant(v * 1e6, 2)),
        v if v < 1.0 => format!("{} ms", significant(v * 1e3, 2)),
        v if v < 99.5 => format!("{} s", significant(v, 2)),
        v => format!("{} min {} s", (v.round() / 60.0).floor(), v.round() % 60.0),
    }
}

/// A size: `640 B`, `1.2 kB`, `34 MB`, `1.5 GB` (powers of ten).
pub fn bytes(value: f64) -> String {
    let (factor, unit) = match value.abs() {
        v if v < 999.5 => return format!("{value:.0} B"),
        v if v < 999.5e3 => (1e3, "kB"),
        v if v < 999.5e6 => (1e6, "MB"),
        v if v < 999.5e9 => (1e9, "GB"),
        _ => (1e12, "TB"),
    };
    format!("{} {unit}", significant(value / factor, 2))
}

/// A share: 0.0123 gives `1.2 %`.
pub fn percent(value: f64) -> String {
    format!("{} %", significant(value * 100.0, 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well_at_every_size() {
        assert_eq!(
            [1234.5, 0.00123, 9.99, 1.26e-7, -4.5e9, 0.0, f64::INFINITY, 0.1].map(|v| significant(v, 2)),
            ["1200", "0.0012", "10", "1.3·10⁻⁷", "−4.5·10⁹", "0", "∞", "0.10"]
        );
        assert_eq!(grouped(-1_234_567), "−1\u{a0}234\u{a0}567");
        assert_eq!([1.23e-5, 0.0456, 2.5, 250.0].map(seconds), ["12 µs", "46 ms", "2.5 s", "4 min 10 s"]);
        assert_eq!([12.0, 1234.0, 5.6e9].map(bytes), ["12 B", "1.2 kB", "5.6 GB"]);
        assert_eq!(superscript(-120), "⁻¹²⁰");
    }
}
