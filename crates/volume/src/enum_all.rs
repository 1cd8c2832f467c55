//! Complete lists of an enum's variants, so loops over "every mode" are right by construction.

/// Gives a fieldless enum its `ALL`; a variant missing from the list does not compile.
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
