//! Trained garments in programs that speak C: what `include/muslin.h` declares.
//!
//! Every function takes NULL for what it is not, and no panic leaves it.

// Pointers come from another language; each is looked at before it is used.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::ptr;
use std::slice;

use muslin::{DressOptions, Playing, Size, Wear};

/// What is returned where nothing is.
pub const NONE: u32 = u32::MAX;

/// A garment that is open.
#[derive(Debug)]
pub struct Garment {
    playing: Playing,
    names: Vec<CString>,
    /// Of the character's joints.
    joints: Vec<CString>,
}

/// Who wears what; zero where it does not matter.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Worn {
    /// Of the wardrobe.
    pub garment: *const c_char,
    /// By name.
    pub fabric: *const c_char,
    /// A letter.
    pub size: *const c_char,
    /// [m]
    pub height: f64,
    /// [kg]
    pub weight: f64,
    /// 0 (male) to 1 (female).
    pub gender: f64,
    /// A character's file.
    pub body: *const c_char,
}

impl Worn {
    /// # Safety
    /// Each text is NULL or ends with a zero.
    unsafe fn options(&self) -> Result<DressOptions, String> {
        // SAFETY: as the caller says.
        let [garment, fabric, size, body] = unsafe {
            [
                text(self.garment)?,
                text(self.fabric)?,
                text(self.size)?,
                text(self.body)?,
            ]
        };
        let given = |x: f64| (x != 0.0).then_some(x);
        let wear = Wear {
            garment: garment.unwrap_or_default().to_owned(),
            fabric: fabric.map(str::to_owned),
        };
        Ok(DressOptions {
            outfit: vec![wear],
            body: body.map(PathBuf::from),
            size: size.map(Size::parse).transpose()?,
            height: given(self.height),
            weight: given(self.weight),
            gender: given(self.gender),
            ..DressOptions::default()
        })
    }
}

/// # Safety
/// The pointer is NULL or to a text that ends with a zero and lives as long as is made of it.
unsafe fn text<'a>(at: *const c_char) -> Result<Option<&'a str>, String> {
    if at.is_null() {
        return Ok(None);
    }
    // SAFETY: as the caller says.
    let text = unsafe { CStr::from_ptr(at) };
    let text = text.to_str().map_err(|_| "a name is no UTF-8".to_owned())?;
    Ok(Some(text))
}

/// See `muslin.h`.
///
/// # Safety
/// `model` is NULL or to `n_bytes` bytes, `wear` NULL or whole, `error` NULL or to `error_room` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_open(
    model: *const c_void,
    n_bytes: usize,
    wear: *const Worn,
    error: *mut c_char,
    error_room: usize,
) -> *mut Garment {
    // SAFETY: as the caller says.
    let open = || unsafe { open((model, n_bytes), wear) };
    let fault = match catch_unwind(open) {
        Ok(Ok(garment)) => return Box::into_raw(Box::new(garment)),
        Ok(Err(fault)) => fault,
        Err(_) => "a fault in Muslin; please report it".to_owned(),
    };
    if !error.is_null() && error_room > 0 {
        let mut n = fault.len().min(error_room - 1);
        while !fault.is_char_boundary(n) {
            n -= 1;
        }
        // SAFETY: there is room for `n` bytes and a zero.
        unsafe {
            ptr::copy_nonoverlapping(fault.as_ptr().cast(), error, n);
            *error.add(n) = 0;
        }
    }
    ptr::null_mut()
}

/// # Safety
/// As [`muslin_open`].
unsafe fn open(
    (model, n_bytes): (*const c_void, usize),
    wear: *const Worn,
) -> Result<Garment, String> {
    // SAFETY: as the caller says.
    let bytes =
        (!model.is_null()).then(|| unsafe { slice::from_raw_parts(model.cast::<u8>(), n_bytes) });
    // SAFETY: as the caller says.
    let mut options = match unsafe { wear.as_ref() } {
        // SAFETY: as the caller says.
        Some(wear) => unsafe { wear.options()? },
        None => DressOptions::default(),
    };
    if wear.is_null() {
        options.outfit.clear();
    }
    let playing = Playing::new(bytes, &options).map_err(|e| e.to_string())?;
    let name = |n: &str| CString::new(n).unwrap_or_default();
    let bones = playing.bones().iter().map(|b| name(&b.name));
    let joints = playing.character_joints().iter().map(|j| name(j));
    Ok(Garment {
        names: bones.collect(),
        joints: joints.collect(),
        playing,
    })
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open, and not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_close(garment: *mut Garment) {
    if !garment.is_null() {
        // SAFETY: it came from `muslin_open`.
        drop(unsafe { Box::from_raw(garment) });
    }
}

/// Asks an open garment.
///
/// # Safety
/// `garment` is NULL or open.
unsafe fn of<T>(garment: *const Garment, none: T, ask: impl FnOnce(&Garment) -> T) -> T {
    // SAFETY: as the caller says.
    match unsafe { garment.as_ref() } {
        Some(garment) => ask(garment),
        None => none,
    }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_vertices(garment: *const Garment) -> u32 {
    // SAFETY: as the caller says.
    unsafe { of(garment, 0, |g| g.playing.n_verts() as u32) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_triangles(garment: *const Garment) -> u32 {
    // SAFETY: as the caller says.
    unsafe { of(garment, 0, |g| g.playing.faces().len() as u32) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_corners(garment: *const Garment) -> *const u32 {
    let corners = |g: &Garment| g.playing.faces().as_flattened().as_ptr();
    // SAFETY: as the caller says.
    unsafe { of(garment, ptr::null(), corners) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_bones(garment: *const Garment) -> u32 {
    // SAFETY: as the caller says.
    unsafe { of(garment, 0, |g| g.names.len() as u32) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_bone_name(garment: *const Garment, bone: u32) -> *const c_char {
    // SAFETY: as the caller says.
    unsafe { of(garment, ptr::null(), |g| nth(&g.names, bone)) }
}

/// A name of a list.
fn nth(names: &[CString], k: u32) -> *const c_char {
    let name = names.get(k as usize);
    name.map_or(ptr::null(), |n| n.as_ptr())
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_bone_parent(garment: *const Garment, bone: u32) -> u32 {
    let parent = |g: &Garment| {
        let bone = g.playing.bones().get(bone as usize);
        bone.and_then(|b| b.parent).map_or(NONE, |p| p as u32)
    };
    // SAFETY: as the caller says.
    unsafe { of(garment, NONE, parent) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open, `joint` NULL or to three numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_bone_joint(garment: *const Garment, bone: u32, joint: *mut f32) {
    let place = |g: &Garment| {
        let place = g.playing.joints().get(bone as usize);
        place.map(|p| p.as_vec3().to_array())
    };
    // SAFETY: as the caller says.
    unsafe { put(of(garment, None, place), joint) };
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_joints(garment: *const Garment) -> u32 {
    // SAFETY: as the caller says.
    unsafe { of(garment, 0, |g| g.joints.len() as u32) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_joint_name(garment: *const Garment, joint: u32) -> *const c_char {
    // SAFETY: as the caller says.
    unsafe { of(garment, ptr::null(), |g| nth(&g.joints, joint)) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open, `matrix` NULL or to sixteen numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_joint_bound(garment: *const Garment, joint: u32, matrix: *mut f32) {
    let place = |g: &Garment| g.playing.character_bound().get(joint as usize).copied();
    // SAFETY: as the caller says.
    unsafe { put(of(garment, None, place), matrix) };
}

/// Gives numbers away where there are any.
///
/// # Safety
/// `to` is NULL or to as many numbers.
unsafe fn put<const N: usize>(numbers: Option<[f32; N]>, to: *mut f32) {
    if let (Some(numbers), false) = (numbers, to.is_null()) {
        // SAFETY: as the caller says.
        unsafe { ptr::copy_nonoverlapping(numbers.as_ptr(), to, N) };
    }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_begin(garment: *mut Garment, seconds: f32) {
    // SAFETY: as the caller says.
    if let Some(g) = unsafe { garment.as_mut() } {
        g.playing.begin(f64::from(seconds));
    }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_motion_level(garment: *mut Garment, level: f32) {
    // SAFETY: as the caller says.
    if let Some(g) = unsafe { garment.as_mut() } {
        g.playing.set_motion_level(level);
    }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open; `turns` is to four numbers a bone, `root` to three, `vertices` to three a vertex.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_frame(
    garment: *mut Garment,
    turns: *const f32,
    root: *const f32,
    vertices: *mut f32,
) -> c_int {
    // SAFETY: as the caller says.
    unsafe { predict(garment, (turns, root), (vertices, None)) }
}

/// See `muslin.h`.
///
/// # Safety
/// As for [`muslin_frame`]; `normals` is to three a vertex as well.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_frame_with_normals(
    garment: *mut Garment,
    turns: *const f32,
    root: *const f32,
    vertices: *mut f32,
    normals: *mut f32,
) -> c_int {
    // SAFETY: as the caller says.
    unsafe { predict(garment, (turns, root), (vertices, Some(normals))) }
}

/// See `muslin.h`.
///
/// # Safety
/// `garment` is NULL or open; `joints` is to sixteen numbers a joint, `vertices` to three a vertex, `normals` NULL or to
/// three a vertex as well.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn muslin_frame_on(
    garment: *mut Garment,
    joints: *const f32,
    vertices: *mut f32,
    normals: *mut f32,
) -> c_int {
    if garment.is_null() || joints.is_null() || vertices.is_null() {
        return 1;
    }
    // SAFETY: none is NULL, and as the caller says.
    let (g, joints) = unsafe {
        let g = &mut *garment;
        let joints = slice::from_raw_parts(joints.cast::<[f32; 16]>(), g.joints.len());
        (g, joints)
    };
    let has_room = !normals.is_null();
    // SAFETY: as the caller says.
    unsafe {
        given(
            &mut g.playing,
            (vertices, normals),
            |playing| match has_room {
                true => playing.frame_on_with_normals(joints).map(facing),
                false => playing.frame_on(joints).map(plain),
            },
        )
    }
}

/// Where cloth lies, and its normals where they were asked for.
type Laid<'a> = (&'a [[f32; 3]], Option<&'a [[f32; 3]]>);

fn plain(at: &[[f32; 3]]) -> Laid<'_> {
    (at, None)
}

fn facing<'a>([at, normals]: [&'a [[f32; 3]]; 2]) -> Laid<'a> {
    (at, Some(normals))
}

/// Gives a `frame` away; 0 if there was one.
///
/// # Safety
/// There is room for three numbers a vertex, in `normals` as well where a frame has any.
unsafe fn given(
    playing: &mut Playing,
    (vertices, normals): (*mut f32, *mut f32),
    frame: impl for<'a> FnOnce(&'a mut Playing) -> Option<Laid<'a>>,
) -> c_int {
    let give = |from: &[[f32; 3]], to: *mut f32| {
        // SAFETY: as the caller says; a copy, for nobody said that there are numbers yet.
        unsafe { ptr::copy(from.as_ptr().cast::<f32>(), to, 3 * from.len()) };
    };
    let given = AssertUnwindSafe(|| {
        let (at, facing) = frame(playing)?;
        give(at, vertices);
        if let Some(facing) = facing {
            give(facing, normals);
        }
        Some(())
    });
    c_int::from(!matches!(catch_unwind(given), Ok(Some(()))))
}

/// A frame, and its normals where there is to be room for them; 0 if there was one.
///
/// # Safety
/// As for [`muslin_frame_with_normals`].
unsafe fn predict(
    garment: *mut Garment,
    (turns, root): (*const f32, *const f32),
    (vertices, normals): (*mut f32, Option<*mut f32>),
) -> c_int {
    let no_room = vertices.is_null() || normals.is_some_and(|n| n.is_null());
    if garment.is_null() || turns.is_null() || root.is_null() || no_room {
        return 1;
    }
    // SAFETY: none is NULL, and as the caller says.
    let (g, turns, root) = unsafe {
        let g = &mut *garment;
        let turns = slice::from_raw_parts(turns.cast::<[f32; 4]>(), g.names.len());
        (g, turns, *root.cast::<[f32; 3]>())
    };
    let room = (vertices, normals.unwrap_or(ptr::null_mut()));
    // SAFETY: as the caller says.
    unsafe {
        given(&mut g.playing, room, |playing| match normals {
            Some(_) => playing.frame_with_normals(turns, root).map(facing),
            None => playing.frame(turns, root).map(plain),
        })
    }
}
