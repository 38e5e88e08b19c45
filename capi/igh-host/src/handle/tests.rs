use std::ffi::c_int;
use std::ptr::from_mut;
use std::sync::atomic::AtomicBool;

use ecan_c_boundary::call;
use ecan_test_support::OnDrop;

use super::*;

struct Object(u32);

/// Value of an object with an open cycle.
const OPEN: u32 = u32::MAX;
const NOTHING: Words = Words { slot: 0, generation: 0, serial: 0, seal: 0 };

static POOL: Pool<Object> = Pool::new();

impl Pooled for Object {
    fn pool() -> &'static Pool<Self> {
        &POOL
    }

    fn has_open_cycle(&self) -> bool {
        self.0 == OPEN
    }
}

fn make(context: &mut Words, value: u32) -> c_int {
    // SAFETY: the context is valid.
    call("make", |call| unsafe {
        init(call, from_mut(context), Kind::Adapter, || Ok(Object(value)))
    })
}

fn value(context: &Words, kind: Kind) -> Result<u32, c_int> {
    value_of(context, kind, Access::Short)
}

fn value_by(context: &Words, access: Access) -> Result<u32, c_int> {
    value_of(context, Kind::Adapter, access)
}

fn value_of(context: &Words, kind: Kind, access: Access) -> Result<u32, c_int> {
    let mut value = 0;
    let code = call("value", |call| {
        // SAFETY: the context is valid.
        value = unsafe { enter::<Object>(call, context, kind, access) }?.0;
        Ok(())
    });
    if code == 0 { Ok(value) } else { Err(code) }
}

fn end(context: &Words) -> c_int {
    call("end", |call| {
        // SAFETY: the context is valid.
        unsafe { enter::<Object>(call, context, Kind::Adapter, Access::Short) }?.leave();
        Ok(())
    })
}

const NONE: Result<u32, c_int> = Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());

#[test]
fn only_the_context_itself_names_the_object() {
    let mut context = Words { slot: 1, generation: 2, serial: 3, seal: 4 };
    assert_eq!(value(&context, Kind::Adapter), NONE);
    assert_eq!(make(&mut context, 7), 0);
    assert_eq!(value(&context, Kind::Adapter), Ok(7));
    assert_eq!(value(&context, Kind::Port), NONE, "of another kind");
    let copy = [context];
    assert_eq!(value(&copy[0], Kind::Adapter), NONE, "a copy elsewhere");
    assert_eq!(make(&mut context, 8), ecan_result_t::ECAN_ERR_ORDER.code());
    let saved = context;
    assert_eq!(end(&context), 0);
    assert_eq!(value(&context, Kind::Adapter), NONE);
    assert_eq!(end(&context), ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());
    // The same place and the same slot, with another object in it.
    assert_eq!(make(&mut context, 9), 0);
    let now = context;
    context = saved;
    assert_eq!(value(&context, Kind::Adapter), NONE, "an old context");
    assert_eq!(make(&mut context, 8), 0, "ends the object whose context was overwritten");
    assert_eq!(value(&context, Kind::Adapter), Ok(8));
    context = now;
    assert_eq!(value(&context, Kind::Adapter), NONE, "of the ended object");
    assert_eq!(make(&mut context, 10), 0);
    assert_eq!(end(&context), 0);
}

const BUSY: Result<u32, c_int> = Err(ecan_result_t::ECAN_ERR_BUSY.code());

/// Runs `body` in a call of this thread on the object.
fn inside(context: &Words, body: impl FnOnce(Call, &mut Entered<Object>)) {
    let code = call("inside", |call| {
        // SAFETY: the context is valid.
        body(call, &mut unsafe { enter(call, context, Kind::Adapter, Access::Short) }?);
        Ok(())
    });
    assert_eq!(code, 0);
}

fn value_in_thread(context: &Words, access: Access) -> Result<u32, c_int> {
    std::thread::scope(|scope| scope.spawn(|| value_by(context, access)).join().unwrap())
}

#[test]
fn object_in_use_is_busy() {
    let mut context = NOTHING;
    assert_eq!(make(&mut context, 7), 0);
    inside(&context, |_, _| {
        assert_eq!(value(&context, Kind::Adapter), BUSY, "of a callback");
        assert_eq!(value_in_thread(&context, Access::Short), BUSY);
    });
    assert_eq!(value(&context, Kind::Adapter), Ok(7));
    assert_eq!(end(&context), 0);
}

#[test]
fn cycle_of_another_thread_admits_short_calls_only() {
    let mut context = NOTHING;
    assert_eq!(make(&mut context, 7), 0);
    inside(&context, |call, entered| {
        assert_eq!(entered.begin_cycle(call), Ok(()));
        entered.sleep(|| {
            assert_eq!(value_in_thread(&context, Access::Short), Ok(7));
            assert_eq!(value_in_thread(&context, Access::Long), BUSY);
        });
        assert_eq!(value_in_thread(&context, Access::Short), BUSY, "after the sleep");
    });
    assert_eq!(value_in_thread(&context, Access::Short), Ok(7), "between two calls of the cycle");
    assert_eq!(value_in_thread(&context, Access::Long), BUSY);
    std::thread::scope(|scope| {
        let other =
            || inside(&context, |call, entered| assert!(entered.begin_cycle(call).is_err()));
        scope.spawn(other).join().unwrap();
    });
    inside(&context, |call, entered| assert_eq!(entered.end_cycle(call), Ok(())));
    assert_eq!(value_in_thread(&context, Access::Long), Ok(7));
    assert_eq!(end(&context), 0);
}

#[test]
#[cfg_attr(miri, ignore = "Miri has no robust mutex: one stays locked when its thread ends")]
fn cycle_ends_with_its_thread() {
    let mut context = NOTHING;
    assert_eq!(make(&mut context, 7), 0);
    // The system may know a thread for some time after its join.
    for _ in 0..1000 {
        std::thread::scope(|scope| {
            let begin = || inside(&context, |call, it| assert_eq!(it.begin_cycle(call), Ok(())));
            scope.spawn(begin).join().unwrap();
        });
        assert_eq!(value_of(&context, Kind::Adapter, Access::Long), Ok(7));
    }
    assert_eq!(end(&context), 0);
}

#[test]
fn cycle_ends_with_its_object() {
    let mut context = NOTHING;
    assert_eq!(make(&mut context, 7), 0);
    inside(&context, |call, entered| assert_eq!(entered.begin_cycle(call), Ok(())));
    assert_eq!(end(&context), 0);
    assert_eq!(make(&mut context, 8), 0, "in a freed slot");
    assert_eq!(value_in_thread(&context, Access::Long), Ok(8));
    assert_eq!(end(&context), 0);
}

#[test]
#[cfg_attr(miri, ignore = "Miri has no robust mutex: one stays locked when its thread ends")]
fn open_cycle_belongs_to_its_thread() {
    let mut context = NOTHING;
    assert_eq!(make(&mut context, 7), 0);
    inside(&context, |_, entered| {
        entered.0 = OPEN;
        entered.keep();
    });
    assert_eq!(value_in_thread(&context, Access::Short), BUSY);
    assert_eq!(value(&context, Kind::Adapter), Ok(OPEN));
    inside(&context, |_, entered| entered.0 = 7);
    assert_eq!(value_in_thread(&context, Access::Short), Ok(7), "after its end");
    std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            inside(&context, |_, entered| {
                entered.0 = OPEN;
                entered.keep();
            });
        });
        thread.join().unwrap();
    });
    assert_eq!(value(&context, Kind::Adapter), Ok(OPEN), "its thread ended");
    assert_eq!(value_in_thread(&context, Access::Long), Ok(OPEN));
    assert_eq!(end(&context), 0);
}

#[test]
fn cycle_thread_never_loses_to_visitors() {
    const CYCLES: u32 = if cfg!(miri) { 50 } else { 500_000 };
    let mut context = NOTHING;
    assert_eq!(make(&mut context, 0), 0);
    // Visitors make room only for the thread that has run a cycle before.
    inside(&context, |call, entered| {
        assert_eq!(entered.begin_cycle(call), Ok(()));
        assert_eq!(entered.end_cycle(call), Ok(()));
    });
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Ends the visitors also after a panic.
        let _end = OnDrop(|| is_done.store(true, Ordering::Relaxed));
        for access in [Access::Short, Access::Short, Access::Long] {
            let (context, is_done) = (&context, &is_done);
            scope.spawn(move || {
                while !is_done.load(Ordering::Relaxed) {
                    let seen = value_by(context, access);
                    assert!(seen.is_ok_and(|value| value != OPEN) || seen == BUSY, "{seen:?}");
                }
            });
        }
        for cycle in 0..CYCLES {
            inside(&context, |call, entered| {
                assert_eq!(entered.begin_cycle(call), Ok(()));
                entered.sleep(|| ());
                entered.0 = OPEN;
                entered.keep();
            });
            assert_eq!(value(&context, Kind::Adapter), Ok(OPEN));
            inside(&context, |call, entered| {
                assert_eq!(entered.end_cycle(call), Ok(()));
                entered.0 = cycle;
            });
            assert_eq!(value(&context, Kind::Adapter), Ok(cycle));
        }
    });
    assert_eq!(end(&context), 0);
}
