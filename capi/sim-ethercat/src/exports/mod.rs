//! The functions under libethercat's names.
//!
//! Each passes its arguments to the simulator's function, which catches panics. The arguments are
//! those of IgH's interface, with the same contract.

/// Exports functions of the simulator. `reported` ones report failures on stderr; `silent` ones are
/// those of the cycle, which the real library keeps silent.
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
    (reported $export:ident $result:ident) => {
        $crate::report::reported(stringify!($export), $result)
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
