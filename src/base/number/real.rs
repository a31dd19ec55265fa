//! Common trait of single and double precision.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Floating-point number: f32 or f64.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + 'static
{
    /// Converts from f64, with rounding.
    fn from_f64(value: f64) -> Self;
    /// Converts to f64, exactly.
    fn to_f64(self) -> f64;
    /// `self · factor + summand`, rounded once; in f32 by way of f64.
    #[must_use]
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    /// Square root √x.
    #[must_use]
    fn sqrt(self) -> Self;
    /// eˣ − 1.
    #[must_use]
    fn exp_m1(self) -> Self;
    /// ln(1 + x).
    #[must_use]
    fn ln_1p(self) -> Self;
    /// Absolute value |x|.
    #[must_use]
    fn abs(self) -> Self;
    /// Rounds down, ⌊x⌋.
    #[must_use]
    fn floor(self) -> Self;
    /// Rounds up, ⌈x⌉.
    #[must_use]
    fn ceil(self) -> Self;
    /// Smaller of two numbers.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// Larger of two numbers.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Truncates to an index; negative numbers become 0.
    fn index(self) -> usize;
}

/// `self · factor + summand` of f32. The product is exact in f64, and the sum rounded twice differs from one rounded once in a bit of
/// one of 2²⁹ numbers; a processor without the instruction, for which programs are built, would take a call of a function.
#[expect(clippy::cast_possible_truncation, reason = "rounds")]
fn fused_f32(number: f32, factor: f32, summand: f32) -> f32 {
    (f64::from(number) * f64::from(factor) + f64::from(summand)) as f32
}

macro_rules! real {
    ($($type:ident $fused:path, $whole:ty, $from:literal);*) => {$(
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_lossless, clippy::cast_precision_loss, trivial_numeric_casts,
            reason = "one text for both; `from_f64` rounds, `index` saturates")]
        impl Real for $type {
            fn from_f64(value: f64) -> Self {
                value as Self
            }
            fn to_f64(self) -> f64 {
                self as f64
            }
            fn mul_add(self, factor: Self, summand: Self) -> Self {
                $fused(self, factor, summand)
            }
            fn sqrt(self) -> Self {
                Self::sqrt(self)
            }
            fn exp_m1(self) -> Self {
                Self::exp_m1(self)
            }
            fn ln_1p(self) -> Self {
                Self::ln_1p(self)
            }
            fn abs(self) -> Self {
                Self::abs(self)
            }
            fn floor(self) -> Self {
                // A call of a function for which programs are built; from this on all numbers are whole.
                if Self::abs(self) < $from {
                    let whole = self as $whole as Self;
                    if whole > self { whole - 1.0 } else { whole }
                } else {
                    self
                }
            }
            fn ceil(self) -> Self {
                -Real::floor(-self)
            }
            fn min(self, other: Self) -> Self {
                Self::min(self, other)
            }
            fn max(self, other: Self) -> Self {
                Self::max(self, other)
            }
            fn index(self) -> usize {
                self as usize
            }
        }
    )*};
}

real!(f32 fused_f32, i32, 8_388_608.0; f64 f64::mul_add, i64, 4_503_599_627_370_496.0);

/// `base^exponent` by repeated squaring, lowest bit first.
pub fn power<R: Real>(base: R, exponent: u32) -> R {
    let (mut result, mut square) = (R::from_f64(1.0), base);
    let mut rest = exponent;
    while rest > 0 {
        if rest & 1 == 1 {
            result = result * square;
        }
        square = square * square;
        rest >>= 1;
    }
    result
}

/// Dot product a · b.
pub fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Unit vector along `a`; zero stays zero.
pub fn unit<R: Real>(a: [R; 3]) -> [R; 3] {
    let square = dot(a, a);
    if square > R::default() {
        let length = square.sqrt();
        a.map(|component| component / length)
    } else {
        [R::default(); 3]
    }
}
