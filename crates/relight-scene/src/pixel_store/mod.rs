//! Training pixels, compact and ready for random access.
//!
//! Held camera by camera as `[pixel][light][rgb]`, 8 bits a channel, so that all lights of a pixel lie together: a ray
//! that is compared with several of its lights touches one or two cache lines.

mod cache;
mod decode;

use std::io;
use std::ops::{ControlFlow, Deref, Range};
use std::path::Path;

use memmap2::Mmap;

use crate::cache_file::{self, CacheEntry, CacheKind};
use crate::error::SceneError;
use crate::scene::Scene;

/// Training pixels of a scene.
pub struct PixelStore {
    views: Vec<View>,
    bytes: Bytes,
    /// Where they are kept, if they are.
    entry: Option<CacheEntry>,
}

/// Where the pixels are.
enum Bytes {
    Memory(Vec<u8>),
    Mapped(Mmap),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Bytes::Memory(bytes) => bytes,
            Bytes::Mapped(map) => map,
        }
    }
}

/// What loading may take, bytes.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    /// Fewer pixels than this decode sooner than anyone notices, and are not cached.
    pub(crate) worth_caching: usize,
    /// A larger view is put together in parts.
    pub(crate) part: usize,
    /// More pixels than this are not held in memory.
    pub(crate) in_memory: usize,
}

impl Limits {
    pub(crate) const USUAL: Limits = Limits { worth_caching: 1 << 24, part: 1 << 29, in_memory: 1 << 32 };
}

/// One camera's pixels.
#[derive(Clone, Debug, PartialEq)]
struct View {
    /// Index of the scene's camera.
    camera: usize,
    /// Indices of the scene's lights, ascending.
    lights: Vec<u32>,
    /// Indices of the scene's frames, in the order of the lights.
    frames: Vec<usize>,
    /// Pixels of the camera's image.
    pixels: usize,
    /// Where its bytes lie in the store.
    bytes: Range<usize>,
}

impl PixelStore {
    /// Decodes the given frames' images on all cores. `progress` is told how many images are done, and of how many, from
    /// whatever thread is at it; if it answers [`ControlFlow::Break`], loading stops and leaves nothing.
    ///
    /// The pixels are kept in a file in `$RELIGHT_CACHE` (else `$XDG_CACHE_HOME/relight`, else `~/.cache/relight`), which
    /// the next start maps into memory at once: the operating system then holds as much of it as there is room for. It
    /// is decoded anew if an image's size or time has changed. Where no such file can be written, and for small scenes,
    /// the pixels are held in memory, up to 4 GiB. While it decodes, it takes up to 0.5 GiB and a few images a thread
    /// besides.
    ///
    /// # Errors
    /// The first image that cannot be decoded, is not of its camera's size, or is black: the official release blacks
    /// out its test images, and training on one is always a mistake. [`SceneError::Memory`], before any image is read, if
    /// there are more pixels than the file's disk has room for and than memory may hold. [`SceneError::Cancelled`] if
    /// `progress` said so.
    pub fn load(
        scene: &Scene,
        frames: &[usize],
        progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
    ) -> Result<PixelStore, SceneError> {
        PixelStore::load_by(scene, frames, progress, cache_file::folder().as_deref(), &Limits::USUAL)
    }

    /// As [`load`](PixelStore::load), with the cache in `folder`, and however few pixels there are.
    ///
    /// # Errors
    /// As [`load`](PixelStore::load).
    pub fn load_through(
        folder: &Path,
        scene: &Scene,
        frames: &[usize],
        progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
    ) -> Result<PixelStore, SceneError> {
        let limits = Limits { worth_caching: 0, ..Limits::USUAL };
        PixelStore::load_by(scene, frames, progress, Some(folder), &limits)
    }

    /// As [`load`](PixelStore::load), with the cache in a given folder and other limits.
    pub(crate) fn load_by(
        scene: &Scene,
        frames: &[usize],
        progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
        cache_folder: Option<&Path>,
        limits: &Limits,
    ) -> Result<PixelStore, SceneError> {
        let (views, length) = lay_out(scene, frames)?;
        let folder = cache_folder.filter(|_| length > 0 && length >= limits.worth_caching);
        let entry = folder.and_then(|folder| cache::entry(folder, scene, &views));
        let mut cache = "there is no folder for it".to_owned();
        if let Some(entry) = entry {
            if let Some(map) = cache::open(&entry, length) {
                return match progress(frames.len(), frames.len()) {
                    ControlFlow::Continue(()) => {
                        Ok(PixelStore { views, bytes: Bytes::Mapped(map), entry: Some(entry) })
                    }
                    ControlFlow::Break(()) => Err(SceneError::Cancelled),
                };
            }
            match decode_to_file(scene, &views, limits.part, progress, &entry, length)? {
                Ok(map) => return Ok(PixelStore { views, bytes: Bytes::Mapped(map), entry: Some(entry) }),
                Err(error) => cache = format!("{}: {error}", entry.path().display()),
            }
            if length <= limits.in_memory {
                tracing::warn!(
                    "{cache}: decoded pixels cannot be kept there: they are held in memory and decoded anew at the next \
                     start. Set RELIGHT_CACHE to a folder with {length} bytes free."
                );
            }
        }
        let mut bytes = Vec::new();
        if length > limits.in_memory || bytes.try_reserve_exact(length).is_err() {
            return Err(SceneError::Memory { bytes: length, cache });
        }
        decode::decode(scene, &views, limits.part, progress, &mut |part| {
            bytes.extend_from_slice(part);
            ControlFlow::Continue(())
        })?;
        Ok(PixelStore { views, bytes: Bytes::Memory(bytes), entry: None })
    }

    /// The place in the cache, beside the pixels, for something made from them and from what `more` describes: a change of
    /// either makes it stale. `None` where the pixels themselves are not kept.
    pub fn cache_entry(&self, kind: CacheKind, more: &str) -> Option<CacheEntry> {
        self.entry.as_ref().map(|entry| entry.beside(kind, more))
    }

    /// Cameras that have at least one of the frames.
    pub fn views(&self) -> usize {
        self.views.len()
    }

    /// The scene's camera, by index, of a view.
    pub fn camera(&self, view: usize) -> usize {
        self.views[view].camera
    }

    /// The scene's lights, by index, that are held for a view, ascending.
    pub fn lights(&self, view: usize) -> &[u32] {
        &self.views[view].lights
    }

    /// Pixels of a view's image: width times height.
    pub fn pixels(&self, view: usize) -> usize {
        self.views[view].pixels
    }

    /// The colours of a view's pixel, one a light in the order of [`lights`](PixelStore::lights). Pixels count row by
    /// row from the top left.
    pub fn pixel(&self, view: usize, pixel: usize) -> &[[u8; 3]] {
        let view = &self.views[view];
        let stride = 3 * view.lights.len();
        let start = view.bytes.start + pixel * stride;
        self.bytes[start..start + stride].as_chunks().0
    }
}

/// Decodes into a cache file. The outer error is an image's, the inner one the file's.
fn decode_to_file(
    scene: &Scene,
    views: &[View],
    part: usize,
    progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
    entry: &CacheEntry,
    length: usize,
) -> Result<io::Result<Mmap>, SceneError> {
    let mut writer = match entry.create(length as u64) {
        Ok(writer) => writer,
        Err(error) => return Ok(Err(error)),
    };
    let mut written = Ok(());
    decode::decode(scene, views, part, progress, &mut |part| {
        written = writer.write(part);
        if written.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    })?;
    Ok(written.and_then(|()| writer.finish()).and_then(cache::map))
}

/// Where each view's pixels go, and how many bytes there are in all.
fn lay_out(scene: &Scene, frames: &[usize]) -> Result<(Vec<View>, usize), SceneError> {
    let mut wanted = Vec::with_capacity(frames.len());
    for &index in frames {
        let count = scene.frames.len();
        let frame = scene.frames.get(index).ok_or(SceneError::NoSuchFrame { frame: index, frames: count })?;
        wanted.push((frame.camera, frame.light, index));
    }
    wanted.sort_unstable();
    wanted.dedup();
    let mut views: Vec<View> = Vec::new();
    let mut start = 0usize;
    for of_camera in wanted.chunk_by(|a, b| a.0 == b.0) {
        let camera = of_camera[0].0;
        let lens = &scene.cameras[camera].intrinsics;
        let pixels = lens.width as usize * lens.height as usize;
        let length = pixels.checked_mul(3 * of_camera.len());
        let end = length.and_then(|length| start.checked_add(length)).ok_or_else(|| SceneError::Memory {
            bytes: usize::MAX,
            cache: "no file is so long".to_owned(),
        })?;
        views.push(View {
            camera,
            lights: of_camera.iter().map(|&(_, light, _)| light as u32).collect(),
            frames: of_camera.iter().map(|&(_, _, frame)| frame).collect(),
            pixels,
            bytes: start..end,
        });
        start = end;
    }
    Ok((views, start))
}
