//! Lists of all variants of an enum that cannot leave one out: what loops over "every mode" is right by construction.

/// Gives a fieldless enum its `ALL`: one that is not named here does not compile.
macro_rules! every {
    ($enum:ident: $($variant:ident)*) => {
        impl $enum {
            /// All variants of this enum.
            pub const ALL: [Self; [$(Self::$variant),*].len()] = [$(Self::$variant),*];
        }

        const _: fn($enum) = |one| match one {
            $($enum::$variant => (),)*
        };
    };
}

pub(crate) use every;
