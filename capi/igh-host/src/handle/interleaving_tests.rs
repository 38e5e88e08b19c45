//! Every order in which a thread uses a context whose object another one ends, by loom.

use std::ffi::c_int;
use std::ptr::from_mut;

use ecan_c_boundary::call;
use loom::thread;

use super::*;

struct Object(u32);

static POOL: Pool<Object> = Pool::new();

impl Pooled for Object {
    fn pool() -> &'static Pool<Self> {
        &POOL
    }
}

fn init_object(context: &mut Words, value: u32) {
    // SAFETY: the context is valid.
    let code = call("init", |call| unsafe {
        init(call, from_mut(context), Kind::Adapter, || Ok(Object(value)))
    });
    assert_eq!(code, 0);
}

fn value(context: &Words) -> Result<u32, c_int> {
    let mut value = 0;
    let code = call("value", |call| {
        // SAFETY: the context is valid.
        value = unsafe { enter::<Object>(call, context, Kind::Adapter, Access::Short) }?.0;
        Ok(())
    });
    if code == 0 { Ok(value) } else { Err(code) }
}

fn end(context: &Words) -> c_int {
    call("end", |call| {
        // SAFETY: the context is valid.
        unsafe { enter::<Object>(call, context, Kind::Adapter, Access::Long) }?.leave();
        Ok(())
    })
}

const ENDED: Result<u32, c_int> = Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());
const BUSY: c_int = ecan_result_t::ECAN_ERR_BUSY.code();

#[test]
fn context_names_its_object_or_nothing() {
    loom::model(|| {
        // Slots belong to the run of the model that has made them.
        POOL.slots().free.clear();
        let nothing = Words { slot: 0, generation: 0, serial: 0, seal: 0 };
        let first = Box::leak(Box::new(nothing));
        init_object(first, 7);
        let first: &'static Words = first;
        let reader = thread::spawn(move || value(first));
        let ended = end(first);
        assert!([0, BUSY].contains(&ended));
        // The next object may use the slot.
        let mut second = nothing;
        init_object(&mut second, 8);
        let read = reader.join().unwrap();
        assert!([Ok(7), ENDED, Err(BUSY)].contains(&read), "{read:?}");
        assert!(ended != 0 || value(first) == ENDED);
        assert_eq!(value(&second), Ok(8));
        POOL.slots().living.clear();
    });
}
