//! What stands in place of each call: it counts, fails where a test wants it, and else goes on.

use std::marker::PhantomData;

use ash::vk;

use crate::dispatch::{Below, Dispatched, Function, below, plan};
use crate::table::{CALLS, Call};

/// Which call it is, by its place in the table.
pub(crate) struct Id<const ID: usize>;

/// What becomes of a call.
enum Fate {
    /// It goes on.
    Goes(Function),
    /// It goes on, and this is what is said of it.
    GoesAndSays(Function, vk::Result),
    /// It never happens.
    Fails(vk::Result),
}

/// Calls that a lost device answers with its loss.
const WORK: [&str; 12] = [
    "vkQueueSubmit",
    "vkQueueSubmit2",
    "vkQueueBindSparse",
    "vkQueueWaitIdle",
    "vkDeviceWaitIdle",
    "vkWaitForFences",
    "vkGetFenceStatus",
    "vkWaitSemaphores",
    "vkGetSemaphoreCounterValue",
    "vkAcquireNextImageKHR",
    "vkQueuePresentKHR",
    "vkWaitForPresentKHR",
];

fn fate(call: &'static Call, wanted: Option<vk::Result>, below: &Below, function: Function) -> Fate {
    let waits = ["vkWaitSemaphores", "vkWaitForFences"].contains(&call.name());
    match wanted {
        Some(vk::Result::ERROR_DEVICE_LOST) => below.lose(),
        Some(vk::Result::TIMEOUT) if waits => below.hang(),
        _ => {}
    }
    match wanted {
        // A lost device shows nothing either.
        Some(vk::Result::ERROR_DEVICE_LOST) => Fate::Fails(vk::Result::ERROR_DEVICE_LOST),
        // What is presented is taken from the program even where the surface is out of date; and an image that is suboptimal was
        // acquired.
        Some(result) if result == vk::Result::SUBOPTIMAL_KHR || call.name() == "vkQueuePresentKHR" => {
            Fate::GoesAndSays(function, result)
        }
        Some(result) => Fate::Fails(result),
        None if below.is_lost() && WORK.contains(&call.name()) => Fate::Fails(vk::Result::ERROR_DEVICE_LOST),
        None if below.is_hung() && waits => Fate::Fails(vk::Result::TIMEOUT),
        None => Fate::Goes(function),
    }
}

/// Decides about a call on a handle, and makes it where it is to be made.
///
/// # Safety
/// The handle is a live one of the loader's; `next` calls the function that it is given with the call's own arguments.
unsafe fn pass<H: Dispatched>(id: usize, handle: H, next: impl FnOnce(Function) -> vk::Result) -> vk::Result {
    let call = &CALLS[id];
    // SAFETY: by this function's contract.
    let below = unsafe { below(handle.key()) };
    let wanted = plan().call(call.name());
    let Some((below, function)) = below.and_then(|below| Some((below.clone(), below.function(id)?))) else {
        plan().stranger(call.name());
        return vk::Result::ERROR_UNKNOWN;
    };
    match fate(call, wanted, &below, function) {
        Fate::Goes(function) => next(function),
        Fate::GoesAndSays(function, result) => {
            let real = next(function);
            // Only what went well can have gone less than well.
            if result == vk::Result::SUBOPTIMAL_KHR && real != vk::Result::SUCCESS { real } else { result }
        }
        Fate::Fails(result) => result,
    }
}

/// For calls of so many arguments, the first of which is a handle: one function `$call` for each of them, and `$hook`, which gives it
/// for the call's type.
macro_rules! hooks {
    ($($hook:ident $call:ident $($kind:ident $argument:ident),*;)+) => { $(
        unsafe extern "system" fn $call<const ID: usize, H: Dispatched, $($kind: Copy),*>(
            handle: H,
            $($argument: $kind),*
        ) -> vk::Result {
            // SAFETY: what was called with live arguments goes on with these; the function below has the call's own type, which
            // is this one's.
            unsafe {
                pass(ID, handle, |function| {
                    let next: unsafe extern "system" fn(H, $($kind),*) -> vk::Result = std::mem::transmute(function);
                    next(handle, $($argument),*)
                })
            }
        }

        pub(crate) fn $hook<const ID: usize, H: Dispatched, $($kind: Copy),*>(
            _: Id<ID>,
            _: PhantomData<unsafe extern "system" fn(H, $($kind),*) -> vk::Result>,
        ) -> Function {
            let call: unsafe extern "system" fn(H, $($kind),*) -> vk::Result = $call::<ID, H, $($kind),*>;
            // SAFETY: whoever asks for the function by its name casts it back to its own type before it calls it.
            unsafe { std::mem::transmute(call) }
        }
    )+ };
}

hooks! {
    one call_one;
    two call_two A a;
    three call_three A a, B b;
    four call_four A a, B b, C c;
    five call_five A a, B b, C c, D d;
    six call_six A a, B b, C c, D d, E e;
    seven call_seven A a, B b, C c, D d, E e, F f;
    eight call_eight A a, B b, C c, D d, E e, F f, G g;
}

/// Pipelines: where none are made, those asked for are null, which programs rely on.
unsafe extern "system" fn call_pipelines<const ID: usize, I>(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const I,
    allocator: *const vk::AllocationCallbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    for i in 0..count as usize {
        // SAFETY: the caller has room for so many.
        unsafe { pipelines.add(i).write(vk::Pipeline::null()) };
    }
    // SAFETY: as for every other call.
    unsafe { call_six::<ID, _, _, _, _, _, _>(device, cache, count, infos, allocator, pipelines) }
}

pub(crate) fn pipelines<const ID: usize, I>(
    _: Id<ID>,
    _: PhantomData<
        unsafe extern "system" fn(
            vk::Device,
            vk::PipelineCache,
            u32,
            *const I,
            *const vk::AllocationCallbacks<'_>,
            *mut vk::Pipeline,
        ) -> vk::Result,
    >,
) -> Function {
    let call: unsafe extern "system" fn(_, _, _, *const I, *const vk::AllocationCallbacks<'_>, _) -> vk::Result =
        call_pipelines::<ID, I>;
    // SAFETY: whoever asks for the function by its name casts it back to its own type before it calls it.
    unsafe { std::mem::transmute(call) }
}
