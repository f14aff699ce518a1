//! The functions of the language: spelling, number of arguments, meaning.

macro_rules! functions {
    ($($variant:ident $name:literal $arity:literal $doc:literal;)*) => {
        /// The functions of the language.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Func {
            $(#[doc = $doc] $variant,)*
        }

        impl Func {
            /// Every function: spelling, number of arguments, meaning.
            pub const ALL: &'static [(Func, &'static str, usize, &'static str)] =
                &[$((Func::$variant, $name, $arity, $doc),)*];
        }
    };
}

functions! {
    Abs "abs" 1 "magnitude";
    Sqrt "sqrt" 1 "square root";
    Exp "exp" 1 "exponential";
    Log "log" 1 "natural logarithm";
    Sin "sin" 1 "sine of radians";
    Cos "cos" 1 "cosine of radians";
    Tan "tan" 1 "tangent of radians";
    Tanh "tanh" 1 "hyperbolic tangent";
    Atan "atan" 1 "arc tangent, radians";
    Sign "sign" 1 "-1, 0 or 1";
    Round "round" 1 "nearest whole number";
    Floor "floor" 1 "largest whole number not above";
    Min "min" 2 "the smaller";
    Max "max" 2 "the larger";
    Clip "clip" 3 "clip(x, lo, hi): x limited to lo..hi";
    If "if" 3 "if(c, a, b): a where c is true, else b";
    Sgn "sgn" 2 "sgn(v, db): sign of v, 0 where |v| <= db";
    Held "held" 2 "held(v, db): the last sign of v beyond db; 0 before the first motion";
    Ahead "ahead" 3 "ahead(v, db, tau): at rest, the next direction of motion times exp(-(time to it)/tau); 0 in motion";
    Deriv "deriv" 2 "deriv(x, n): time derivative, straight line over 2n+1 rows";
    Integ "integ" 1 "time integral from the start of the sequence (trapezoid)";
    Delay "delay" 2 "delay(x, s): x as it was s seconds ago (linear between rows; ends held)";
    DelayHeld "delay_held" 2 "delay_held(x, s): the same where the steps of x from row to row are held between rows";
    Warp "warp" 2 "warp(x, r): x read at time t0 + (t - t0)(1 + r), t0 the start of the sequence";
    Lowpass "lowpass" 2 "lowpass(x, tau): first-order lag, starting in equilibrium";
    LowpassHeld "lowpass_held" 2 "lowpass_held(x, tau): the same where the steps of x from row to row are held between rows";
    Charge "charge" 2 "charge(x, tau): first-order lag, starting at zero";
    Play "play" 2 "play(x, w): backlash operator of total width w";
    Stop "stop" 2 "stop(x, w): elastic-plastic operator, x - play(x, w), between -w/2 and w/2";
    Slew "slew" 2 "slew(x, r): x followed at no more than r per second, starting in equilibrium";
    Dahl "dahl" 2 "dahl(x, d): Dahl friction state between -1 and 1 with sliding distance d";
    SeqMean "seqmean" 1 "mean over the sequence";
}

impl Func {
    pub(super) fn lookup(name: &str) -> Option<(Func, usize)> {
        Func::ALL.iter().find(|f| f.1 == name).map(|f| (f.0, f.2))
    }

    pub(super) fn name(self) -> &'static str {
        Func::ALL.iter().find(|f| f.0 == self).map_or("?", |f| f.1)
    }
}
