//! Inner loops for the vector instructions of the machine.

/// A type to hand to `pulp::Arch::dispatch`, which calls `function` with its fields: `kernel!(Sum<'a>(values: &'a [f64]) -> f64 = sum)`.
/// `function` is marked `#[inline(always)]`. A closure would not do: that is a function of its own, which the compiler may leave with the
/// instructions of the oldest machine.
#[macro_export]
macro_rules! kernel {
    ($name:ident<$life:lifetime>($($argument:ident: $type:ty),+) -> $output:ty = $function:ident) => {
        struct $name<$life>($($type),+);

        impl pulp::WithSimd for $name<'_> {
            type Output = $output;

            #[inline(always)]
            fn with_simd<S: pulp::Simd>(self, _: S) -> $output {
                let Self($($argument),+) = self;
                $function($($argument),+)
            }
        }
    };
}
