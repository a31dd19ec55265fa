//! JPEG-LS: codestreams of one component, lossless and near-lossless (ITU-T T.87, June 1998).
//!
//! Names and numbers of steps are those of the recommendation.

/// Contexts of the regular mode, after the merging of signs.
const CONTEXTS: usize = 365;
/// Lengths of runs as powers of 2, by the index of the run (A.2.1, J).
const J: [u32; 32] =
    [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// Bounds of the correction of a prediction.
const CORRECTIONS: [i32; 2] = [-128, 127];

/// Parameters of a scan (C.2.4.1.1).
struct Parameters {
    /// Largest number.
    most: i32,
    /// Largest error.
    near: i32,
    /// Thresholds of gradients.
    thresholds: [i32; 3],
    /// Samples after which statistics are halved.
    reset: i32,
}

impl Parameters {
    /// Default thresholds (C.2.4.1.1.1).
    fn thresholds(most: i32, near: i32) -> [i32; 3] {
        let clamped =
            |threshold: i32, least: i32| if threshold > most || threshold < least { least } else { threshold };
        let [one, two, three] = if most >= 128 {
            let factor = (most.min(4095) + 128) / 256;
            [factor + 2 + 3 * near, factor * 4 + 3 + 5 * near, factor * 17 + 4 + 7 * near]
        } else {
            let factor = 256 / (most + 1);
            [2.max(3 / factor + 3 * near), 3.max(7 / factor + 5 * near), 4.max(21 / factor + 7 * near)]
        };
        let one = clamped(one, near + 1);
        let two = clamped(two, one);
        [one, two, clamped(three, two)]
    }
}

/// The `rows` × `columns` numbers of the codestream `bytes`. Its size has been compared with these.
///
/// # Errors
///
/// A sentence about what is damaged, or not decoded.
pub(super) fn decode(bytes: &[u8], [columns, rows]: [usize; 2]) -> Result<Vec<u16>, String> {
    let (parameters, scan) = parsed(bytes)?;
    let mut decoder = Decoder::new(&parameters, scan);
    let mut numbers = Vec::new();
    // A sample before the line and one behind it.
    let (mut above, mut line) = (vec![0_i32; columns + 2], vec![0_i32; columns + 2]);
    for row in 0..rows {
        above[columns + 1] = above[columns];
        line[0] = above[1];
        decoder.line(&above, &mut line).map_err(|problem| format!("{problem}, in row {row}"))?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 16 bits")]
        numbers.extend(line[1..=columns].iter().map(|&number| number as u16));
        std::mem::swap(&mut above, &mut line);
    }
    Ok(numbers)
}

/// Parameters of the scan, and its bytes with what follows.
fn parsed(bytes: &[u8]) -> Result<(Parameters, &[u8]), String> {
    let mut rest = bytes.strip_prefix(&[0xff, 0xd8]).ok_or("it does not begin with SOI")?;
    let (mut most, mut thresholds, mut reset) = (0, [0; 3], 0);
    loop {
        while let [0xff, 0xff, ..] = rest {
            rest = &rest[1..];
        }
        let &[0xff, marker, a, b, ..] = rest else {
            return Err("it ends before its scan".to_owned());
        };
        let length = usize::from(u16::from_be_bytes([a, b]));
        let segment = rest.get(4..2 + length).ok_or_else(|| format!("the segment ff{marker:02x} is cut"))?;
        let word =
            |at: usize| segment.get(at..at + 2).map_or(0, |word| i32::from(u16::from_be_bytes([word[0], word[1]])));
        match (marker, segment) {
            (0xf7, &[precision, _, _, _, _, components, ..]) => {
                if !(2..=16).contains(&precision) || components != 1 {
                    return Err(format!("{components} components of {precision} bits; one of 2 to 16 is decoded"));
                }
                most = (1 << precision) - 1;
            }
            (0xf8, &[1, ..]) if segment.len() >= 11 => {
                let stated = word(1);
                if stated > most {
                    return Err(format!("its largest number is {stated}, above {most}"));
                }
                most = if stated > 0 { stated } else { most };
                (thresholds, reset) = ([word(3), word(5), word(7)], word(9));
            }
            (0xf8, _) => return Err("it has a mapping table or extended parameters, which are not decoded".to_owned()),
            (0xdd, _) => return Err("it has restart intervals, which are not decoded".to_owned()),
            (0xda, &[1, _, _, near, 0, _, ..]) if most > 0 => {
                let near = i32::from(near);
                if near > (most / 2).min(255) {
                    return Err(format!("an error of {near} is too large for numbers up to {most}"));
                }
                let defaults = Parameters::thresholds(most, near);
                let thresholds = [0, 1, 2].map(|at| if thresholds[at] > 0 { thresholds[at] } else { defaults[at] });
                let [one, two, three] = thresholds;
                if !(near < one && one <= two && two <= three && three <= most) {
                    return Err(format!("the thresholds {one}, {two}, {three} are not in order"));
                }
                let reset = if reset > 0 { reset } else { 64 };
                if reset < 3 {
                    return Err(format!("statistics are halved after {reset} samples; 3 is the least"));
                }
                return Ok((Parameters { most, near, thresholds, reset }, &rest[2 + length..]));
            }
            (0xda, _) => return Err("its scan is interleaved, or has no frame header".to_owned()),
            _ => {}
        }
        rest = &rest[2 + length..];
    }
}

/// Statistics of a context (A.2.1).
#[derive(Clone, Copy)]
struct Context {
    /// Sum of the sizes of errors.
    a: i32,
    /// Sum of errors, as far as the correction does not include them.
    b: i32,
    /// Correction of the prediction.
    c: i32,
    /// Number of samples.
    n: i32,
}

/// State of a scan.
struct Decoder<'a> {
    bits: Bits<'a>,
    contexts: Vec<Context>,
    /// Statistics of the samples that end runs, by `RItype`: sum of sizes, number, number of negative ones.
    ends: [[i32; 3]; 2],
    run: usize,
    most: i32,
    near: i32,
    thresholds: [i32; 3],
    reset: i32,
    /// Distance of neighbouring errors, 2 · near + 1.
    step: i32,
    range: i32,
    /// Bits of an error that is written as it is.
    qbpp: u32,
    /// Longest code.
    limit: u32,
}

/// The least k with 2ᵏ ≥ `number`.
fn bits_for(number: i32) -> u32 {
    number.max(1).unsigned_abs().next_power_of_two().trailing_zeros()
}

impl<'a> Decoder<'a> {
    fn new(&Parameters { most, near, thresholds, reset }: &Parameters, scan: &'a [u8]) -> Self {
        let step = 2 * near + 1;
        let range = (most + 2 * near) / step + 1;
        let bpp = bits_for(most + 1).max(2);
        let a = ((range + 32) / 64).max(2);
        Self {
            bits: Bits::new(scan),
            contexts: vec![Context { a, b: 0, c: 0, n: 1 }; CONTEXTS],
            ends: [[a, 1, 0]; 2],
            run: 0,
            most,
            near,
            thresholds,
            reset,
            step,
            range,
            qbpp: bits_for(range),
            limit: 2 * (bpp + bpp.max(8)),
        }
    }

    /// Decodes a line; both lines have a sample before them, and the one `above` one behind it.
    fn line(&mut self, above: &[i32], line: &mut [i32]) -> Result<(), &'static str> {
        let columns = line.len() - 2;
        let mut x = 1;
        while x <= columns {
            let (left, up, corner, right) = (line[x - 1], above[x], above[x - 1], above[x + 1]);
            let gradients = [right - up, up - corner, corner - left];
            let context = gradients.iter().fold(0, |context, &gradient| 9 * context + self.quantised(gradient));
            if context != 0 {
                line[x] = self.regular(context, [left, up, corner])?;
                x += 1;
                continue;
            }
            let length = self.run(columns + 1 - x)?;
            line[x..x + length].fill(left);
            x += length;
            if x <= columns {
                line[x] = self.end_of_run(left, above[x])?;
                self.run = self.run.saturating_sub(1);
                x += 1;
            }
        }
        Ok(())
    }

    /// The region of a gradient, −4 to 4 (A.3.3).
    #[inline]
    fn quantised(&self, gradient: i32) -> i32 {
        let size = gradient.abs();
        let [one, two, three] = self.thresholds;
        let region =
            i32::from(size > self.near) + i32::from(size >= one) + i32::from(size >= two) + i32::from(size >= three);
        if gradient < 0 { -region } else { region }
    }

    /// Decodes a sample of a signed context (A.4 to A.6).
    #[inline]
    fn regular(&mut self, context: i32, [left, up, corner]: [i32; 3]) -> Result<i32, &'static str> {
        let is_negative = context < 0;
        let Self { most, near, step, reset, .. } = *self;
        let context = &mut self.contexts[context.unsigned_abs() as usize];
        let Context { mut a, mut b, mut c, mut n } = *context;
        let (low, high) = (left.min(up), left.max(up));
        let predicted = if corner >= high {
            low
        } else if corner <= low {
            high
        } else {
            left + up - corner
        };
        let predicted = (if is_negative { predicted - c } else { predicted + c }).clamp(0, most);
        let k = order(n, a)?;
        let mapped = self.bits.golomb(k, self.limit, self.qbpp)?;
        let half = mapped >> 1;
        // Odd codes are negative, unless the statistics are (A.5.2).
        let is_inverted = k == 0 && near == 0 && 2 * b <= -n;
        let error = if (mapped & 1 == 1) == is_inverted { half } else { -half - 1 };
        a += error.abs();
        b += error * step;
        if n == reset {
            a >>= 1;
            b >>= 1;
            n >>= 1;
        }
        n += 1;
        if b <= -n {
            b = (b + n).max(1 - n);
            c = (c - 1).max(CORRECTIONS[0]);
        } else if b > 0 {
            b = (b - n).min(0);
            c = (c + 1).min(CORRECTIONS[1]);
        }
        *context = Context { a, b, c, n };
        Ok(self.restored(predicted, if is_negative { -error } else { error }))
    }

    /// The number at an error from its prediction (A.4.5).
    #[inline]
    fn restored(&self, predicted: i32, error: i32) -> i32 {
        let number = predicted + error * self.step;
        let turn = self.range * self.step;
        let number = if number < -self.near {
            number + turn
        } else if number > self.most + self.near {
            number - turn
        } else {
            number
        };
        number.clamp(0, self.most)
    }

    /// Decodes the length of a run, at most `left` (A.7.1).
    fn run(&mut self, left: usize) -> Result<usize, &'static str> {
        let mut length = 0;
        while self.bits.take(1)? == 1 {
            let whole = 1 << J[self.run];
            if whole > left - length {
                return Ok(left);
            }
            length += whole;
            self.run = (self.run + 1).min(J.len() - 1);
            if length == left {
                return Ok(left);
            }
        }
        let rest = self.bits.take(J[self.run])?;
        length += usize::try_from(rest).unwrap_or(usize::MAX);
        if length >= left { Err("a run goes beyond its line") } else { Ok(length) }
    }

    /// Decodes the sample that ends a run (A.7.2).
    fn end_of_run(&mut self, left: i32, up: i32) -> Result<i32, &'static str> {
        let kind = usize::from((left - up).abs() <= self.near);
        let [mut a, mut n, mut negative] = self.ends[kind];
        let is_alike = i32::from(kind == 1);
        let k = order(n, a + if kind == 1 { n >> 1 } else { 0 })?;
        let mapped = self.bits.golomb(k, self.limit - J[self.run] - 1, self.qbpp)?;
        let code = mapped + is_alike;
        let size = (code + (code & 1)) / 2;
        let is_negative = (k != 0 || 2 * negative >= n) == (code & 1 == 1);
        let error = if is_negative { -size } else { size };
        negative += i32::from(error < 0);
        a += (mapped + 1 - is_alike) >> 1;
        if n == self.reset {
            a >>= 1;
            n >>= 1;
            negative >>= 1;
        }
        n += 1;
        self.ends[kind] = [a, n, negative];
        let predicted = if kind == 1 { left } else { up };
        Ok(self.restored(predicted, if kind == 0 && left > up { -error } else { error }))
    }
}

/// The order of the Golomb code: the least k with `n` · 2ᵏ ≥ `a` (A.5.1).
#[inline]
fn order(n: i32, a: i32) -> Result<u32, &'static str> {
    if n >= a {
        return Ok(0);
    }
    let k = n.leading_zeros() - a.leading_zeros();
    let k = k + u32::from(n << k < a);
    if k < 24 { Ok(k) } else { Err("its statistics are out of range") }
}

/// Bits of a scan, in which a bit 0 follows each byte 0xff (A.1).
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The next bits, from the highest one on.
    bits: u64,
    count: u32,
    is_behind_ff: bool,
}

impl<'a> Bits<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, bits: 0, count: 0, is_behind_ff: false }
    }

    /// Takes as many bytes as fit, up to a marker.
    #[inline]
    fn fill(&mut self) {
        while self.count <= 56 {
            let Some(&byte) = self.bytes.get(self.at) else { return };
            if self.is_behind_ff {
                if byte >= 0x80 {
                    return;
                }
                self.bits |= u64::from(byte) << (57 - self.count);
                self.count += 7;
                self.is_behind_ff = false;
            } else {
                // A byte 0xff before a marker is part of the marker.
                self.is_behind_ff = byte == 0xff;
                if self.is_behind_ff && self.bytes.get(self.at + 1).is_none_or(|&next| next >= 0x80) {
                    self.is_behind_ff = false;
                    return;
                }
                self.bits |= u64::from(byte) << (56 - self.count);
                self.count += 8;
            }
            self.at += 1;
        }
    }

    /// The next `count` bits, at most 32.
    #[inline]
    fn take(&mut self, count: u32) -> Result<u32, &'static str> {
        if count == 0 {
            return Ok(0);
        }
        if self.count < count {
            self.fill();
            if self.count < count {
                return Err("it ends early");
            }
        }
        let bits = self.bits >> (64 - count);
        self.bits <<= count;
        self.count -= count;
        u32::try_from(bits).map_err(|_| "it ends early")
    }

    /// A number in a Golomb code of order `k` of at most `limit` bits (A.5.3).
    #[inline]
    fn golomb(&mut self, k: u32, limit: u32, qbpp: u32) -> Result<i32, &'static str> {
        let escape = limit - qbpp - 1;
        let mut zeros = 0;
        loop {
            if self.count < 32 {
                self.fill();
            }
            let here = self.bits.leading_zeros().min(self.count);
            zeros += here;
            if zeros > escape || self.count == 0 {
                return Err(if self.count == 0 { "it ends early" } else { "a code is too long" });
            }
            let is_found = here < self.count;
            let used = here + u32::from(is_found);
            self.bits = self.bits.checked_shl(used).unwrap_or(0);
            self.count -= used;
            if is_found {
                break;
            }
        }
        let number = if zeros < escape { zeros << k | self.take(k)? } else { self.take(qbpp)? + 1 };
        i32::try_from(number).map_err(|_| "a code is too large")
    }
}
