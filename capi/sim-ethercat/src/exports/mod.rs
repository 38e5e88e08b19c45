//! The functions under libethercat's names.
//!
//! Each passes its arguments on to the simulator's function, which catches its own panics. The
//! arguments are those of IgH's interface, under the same promises.

/// Exports functions of the simulator. `told` ones say on stderr that they failed; the others are
/// those for the cycle, which the real library keeps silent.
macro_rules! export {
    ($(
        $manner:ident $export:ident($($argument:ident: $type:ty),*) $(-> $result:ty)? = $function:ident;
    )*) => { $(
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $export($($argument: $type),*) $(-> $result)? {
            // SAFETY: the same arguments under the same promises.
            let result = unsafe { ::ecan_sim::libethercat::$function($($argument),*) };
            export!($manner $export result)
        }
    )* };
    (told $export:ident $result:ident) => {
        $crate::report::told(stringify!($export), $result)
    };
    (silent $export:ident $result:ident) => {
        $result
    };
}

mod configuration;
mod master;
mod opening;
mod other_mailbox_protocols;
mod process_data;
mod requests;
