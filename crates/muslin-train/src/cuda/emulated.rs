//! Kernels on this machine's processor.

use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::process::Command;
use std::sync::{Arc, LazyLock, Mutex};

use super::{Arg, Array};

/// Threads of a block here.
pub const BLOCK: u32 = 32;
/// And of one that solves.
pub const SOLVERS: u32 = 4;

type Launch =
    unsafe extern "C" fn(*const c_char, c_uint, c_uint, c_uint, *mut *mut c_void) -> c_int;

/// Kernels that were compiled for this machine.
#[derive(Clone, Debug)]
pub struct Emulated {
    /// One kernel at a time: what they share is there once.
    library: Arc<Mutex<libloading::Library>>,
}

/// Once for all tests.
static EMULATED: LazyLock<Option<Emulated>> = LazyLock::new(Emulated::build);

impl Emulated {
    /// None where this machine has no C compiler.
    pub fn new() -> Option<Self> {
        EMULATED.clone()
    }

    fn build() -> Option<Self> {
        if Command::new("cc").arg("--version").output().is_err() {
            println!("skipped: no C compiler (cc)");
            return None;
        }
        let test = std::env::current_exe().expect("a test is a file");
        // A name of its own: two processes may test at once.
        let name = format!("training-kernels-{}.so", std::process::id());
        let library = test.with_file_name(name);
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/src/cuda/emulated.c");
        let built = Command::new("cc")
            .args(["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror"])
            .args(["-shared", "-fPIC"])
            .args([format!("-DBLOCK={BLOCK}"), format!("-DSOLVERS={SOLVERS}")])
            .args([source, "-lm", "-o"])
            .arg(&library)
            .output()
            .expect("it can be run");
        let said = String::from_utf8_lossy(&built.stderr);
        assert!(built.status.success(), "{said}");
        // SAFETY: our own library, which does nothing when it is loaded.
        let loaded = unsafe { libloading::Library::new(&library) }.expect("it was built");
        std::fs::remove_file(&library).expect("it is loaded");
        Some(Self {
            library: Arc::new(Mutex::new(loaded)),
        })
    }

    pub(super) fn launch(
        &self,
        (kernel, block): (&'static str, u32),
        grid: [u32; 2],
        args: &[Arg<'_>],
    ) {
        let library = self.library.lock().expect("no kernel fails");
        let mut places: Vec<*const c_void> = Vec::new();
        for arg in args {
            if let Arg::Array(Array::Emulated(a)) = arg {
                places.push(a.as_ptr().cast());
            }
        }
        let mut arrays = places.iter();
        let mut all: Vec<*mut c_void> = Vec::with_capacity(args.len() + 1);
        for arg in args {
            let at: *const c_void = match arg {
                Arg::Array(_) => std::ptr::from_ref(arrays.next().expect("an array each")).cast(),
                Arg::Count(n) => std::ptr::from_ref(n).cast(),
                Arg::Number(x) => std::ptr::from_ref(x).cast(),
            };
            all.push(at.cast_mut());
        }
        all.push(std::ptr::null_mut());
        let name = CString::new(kernel).expect("a name");
        // SAFETY: arrays are cells, which others may change; `launch` finds out whether there are as many arguments as
        // the kernel has.
        let failed = unsafe {
            let launch: libloading::Symbol<'_, Launch> = library.get("launch").expect("it has one");
            launch(name.as_ptr(), grid[0], grid[1], block, all.as_mut_ptr())
        };
        assert_eq!(failed, 0, "{kernel} with {} arguments", args.len());
    }
}
