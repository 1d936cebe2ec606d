//! Video: H.264 in MP4, which browsers and players everywhere show.

use std::io::{Seek, SeekFrom, Write};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use openh264::OpenH264API;
use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, MatrixCoefficients, QpRange,
    RateControlMode, VuiConfig,
};
use openh264::formats::{RgbSliceU8, YUVBuffer};
use relight_scene::Image;
use shiguredo_mp4::TrackKind;
use shiguredo_mp4::bitstream::h264::{
    H264SampleEntryConfig, LengthSize, annexb_to_length_prefixed, build_avc1_box_from_annexb,
};

use shiguredo_mp4::boxes::SampleEntry;
use shiguredo_mp4::mux::{Mp4FileMuxer, Mp4FileMuxerOptions, Sample, estimate_maximum_moov_box_size};
use tempfile::NamedTempFile;

use crate::error::RenderError;
use crate::files::temporary_beside;

/// Length prefix of a unit of the video stream.
const PREFIX: LengthSize = LengthSize::FourBytes;
/// Quantisers between which the encoder chooses: what it loses is not seen, about 43 dB of luma on woven cloth.
const FINEST: u8 = 16;
const COARSEST: u8 = 22;
/// Bits a second that the quantisers may be refined for.
const BIT_RATE: u32 = 20_000_000;
/// The encoder's limits, pixels.
const SMALLEST: u32 = 16;
const LONGEST: u32 = 3840;
const SHORTEST: u32 = 2160;

/// A video in the making. Frames are encoded and written one by one; the file appears under its name when it is
/// [finished](Video::finish).
pub(crate) struct Video {
    path: PathBuf,
    file: NamedTempFile,
    encoder: Encoder,
    muxer: Mp4FileMuxer,
    frame_rate: NonZeroU32,
    /// Where the next frame goes in the file.
    position: u64,
    /// Width and height of the frames, known after the first.
    size: Option<(u32, u32)>,
}

impl Video {
    /// A video of about `frames` frames at `frame_rate` frames a second: room for their index is kept at the file's
    /// start, so that browsers can play it while it loads.
    pub(crate) fn create(path: &Path, frame_rate: NonZeroU32, frames: usize) -> Result<Video, RenderError> {
        // The conversion of `YUVBuffer` is that of BT.601, studio range.
        let colours = VuiConfig::srgb().matrix_coefficients(MatrixCoefficients::Smpte170M).full_range(false);
        let config = EncoderConfig::new()
            .rate_control_mode(RateControlMode::Bufferbased)
            .bitrate(BitRate::from_bps(BIT_RATE))
            .qp(QpRange::new(FINEST, COARSEST))
            .skip_frames(false)
            .max_frame_rate(FrameRate::from_hz(frame_rate.get() as f32))
            .intra_frame_period(IntraFramePeriod::from_num_frames(frame_rate.get()))
            .vui(colours);
        let failed = |error: openh264::Error| RenderError::film(path, error);
        let encoder = Encoder::with_api_config(OpenH264API::from_source(), config).map_err(failed)?;
        let options = Mp4FileMuxerOptions {
            reserved_moov_box_size: estimate_maximum_moov_box_size(&[frames]),
            ..Mp4FileMuxerOptions::default()
        };
        let muxer = Mp4FileMuxer::with_options(options).map_err(|error| RenderError::film(path, error))?;
        let mut file = temporary_beside(path)?;
        file.write_all(muxer.initial_boxes_bytes()).map_err(RenderError::io(path))?;
        let position = muxer.initial_boxes_bytes().len() as u64;
        Ok(Video { path: path.to_owned(), file, encoder, muxer, frame_rate, position, size: None })
    }

    /// Encodes a frame. Sides are made even by repeating the last column or row.
    pub(crate) fn push(&mut self, frame: &Image) -> Result<(), RenderError> {
        let size = (frame.width, frame.height);
        let bytes = 3 * frame.width as usize * frame.height as usize;
        if size != *self.size.get_or_insert(size) || frame.data.len() != bytes {
            return Err(RenderError::film(&self.path, "the frames of a video must be whole and of one size"));
        }
        let (long, short) = (frame.width.max(frame.height), frame.width.min(frame.height));
        if short < SMALLEST || long > LONGEST || short > SHORTEST {
            let problem = format!(
                "a frame of {}x{} pixels is beyond H.264 video of {SMALLEST}x{SMALLEST} to {LONGEST}x{SHORTEST} pixels: \
                 choose another size, or write the frames into a folder",
                frame.width, frame.height
            );
            return Err(RenderError::film(&self.path, problem));
        }
        let (data, size) = evened(frame);
        let yuv = YUVBuffer::from_rgb8_source(RgbSliceU8::new(&data, size));
        let stream = self.encoder.encode(&yuv).map_err(|error| RenderError::film(&self.path, error))?;
        let keyframe = matches!(stream.frame_type(), FrameType::IDR | FrameType::I);
        let annex_b = stream.to_vec();
        self.append(&annex_b, keyframe)
    }

    /// Writes an encoded frame and tells the index of it.
    fn append(&mut self, annex_b: &[u8], keyframe: bool) -> Result<(), RenderError> {
        let failed = |error: shiguredo_mp4::Error| RenderError::film(&self.path, error);
        let sample_entry = if keyframe {
            let config = H264SampleEntryConfig { length_size: PREFIX };
            Some(SampleEntry::Avc1(build_avc1_box_from_annexb(annex_b, &config).map_err(failed)?))
        } else {
            None
        };
        let data = annexb_to_length_prefixed(annex_b, PREFIX).map_err(failed)?;
        self.file.write_all(&data).map_err(RenderError::io(&self.path))?;
        let sample = Sample {
            track_kind: TrackKind::Video,
            sample_entry,
            keyframe,
            timescale: self.frame_rate,
            duration: 1,
            composition_time_offset: None,
            data_offset: self.position,
            data_size: data.len(),
        };
        self.muxer.append_sample(&sample).map_err(|error| RenderError::film(&self.path, error))?;
        self.position += data.len() as u64;
        Ok(())
    }

    /// Writes the index and gives the file its name.
    pub(crate) fn finish(mut self) -> Result<(), RenderError> {
        if self.size.is_none() {
            return Err(RenderError::film(&self.path, "a video needs at least one frame"));
        }
        let boxes = self.muxer.finalize().map_err(|error| RenderError::film(&self.path, error))?;
        for (offset, bytes) in boxes.offset_and_bytes_pairs() {
            let file = self.file.as_file_mut();
            file.seek(SeekFrom::Start(offset))
                .and_then(|_| file.write_all(bytes))
                .map_err(RenderError::io(&self.path))?;
        }
        self.file.persist(&self.path).map_err(|error| RenderError::io(&self.path)(error.error))?;
        Ok(())
    }
}

/// The pixels of an image whose sides are made even, and the sides.
fn evened(image: &Image) -> (Vec<u8>, (usize, usize)) {
    let (width, height) = (image.width as usize, image.height as usize);
    let size = (width.next_multiple_of(2), height.next_multiple_of(2));
    let mut data = Vec::with_capacity(3 * size.0 * size.1);
    for row in (0..size.1).map(|y| y.min(height - 1)) {
        let row = &image.data[3 * width * row..3 * width * (row + 1)];
        data.extend_from_slice(row);
        if size.0 > width {
            data.extend_from_slice(&row[row.len() - 3..]);
        }
    }
    (data, size)
}
