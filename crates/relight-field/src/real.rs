//! The numbers that scalar code is written over: `f32`, as engines compute, and `f64`, in which derivatives can be
//! checked against finite differences.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A real number.
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
    + AddAssign
    + Sum
    + 'static
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// The nearest number to `v`.
    fn from_f64(v: f64) -> Self;
    /// The number itself.
    fn to_f64(self) -> f64;
    /// The natural exponential.
    fn exp(self) -> Self;
    /// The square root.
    fn sqrt(self) -> Self;
    /// The sine.
    fn sin(self) -> Self;
    /// The cosine.
    fn cos(self) -> Self;
    /// The magnitude.
    fn abs(self) -> Self;
    /// The larger of two; the other one where one is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller of two; the other one where one is not a number.
    fn min(self, other: Self) -> Self;
    /// Whether it is neither infinite nor not a number.
    fn is_finite(self) -> bool;

    /// The nearest number to `v`.
    fn from_f32(v: f32) -> Self {
        Self::from_f64(f64::from(v))
    }

    /// The nearest `f32`.
    fn to_f32(self) -> f32 {
        self.to_f64() as f32
    }

    /// The logistic function `1 / (1 + exp(-x))`.
    fn sigmoid(self) -> Self {
        Self::ONE / (Self::ONE + (-self).exp())
    }
}

macro_rules! real {
    ($($t:ty),*) => {$(
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            fn from_f64(v: f64) -> Self {
                v as Self
            }
            fn to_f64(self) -> f64 {
                self.into()
            }
            fn exp(self) -> Self {
                self.exp()
            }
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            fn sin(self) -> Self {
                self.sin()
            }
            fn cos(self) -> Self {
                self.cos()
            }
            fn abs(self) -> Self {
                self.abs()
            }
            fn max(self, other: Self) -> Self {
                self.max(other)
            }
            fn min(self, other: Self) -> Self {
                self.min(other)
            }
            fn is_finite(self) -> bool {
                self.is_finite()
            }
        }
    )*};
}

real!(f32, f64);
