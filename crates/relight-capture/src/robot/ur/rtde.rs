//! The frames of Universal Robots' real-time data exchange, version 2 (UR, "Real-Time Data Exchange (RTDE) Guide").
//!
//! A frame is its size (u16, this header included), its kind (u8) and a payload, big-endian. Both sides use this file:
//! the driver and the simulated controller.

/// Kinds of frames, each the ASCII code of a letter.
pub(in super::super) mod kind {
    pub const VERSION: u8 = b'V';
    pub const CONTROLLER_VERSION: u8 = b'v';
    pub const DATA: u8 = b'U';
    pub const OUTPUTS: u8 = b'O';
    pub const INPUTS: u8 = b'I';
    pub const START: u8 = b'S';
    pub const PAUSE: u8 = b'P';
}

/// Bytes of size and kind.
const HEADER: usize = 3;

/// The length of the frame at the start of `bytes`, `None` if too few are there.
pub(in super::super) fn frame_length(bytes: &[u8]) -> Result<Option<usize>, String> {
    let [high, low, kind, ..] = *bytes else { return Ok(None) };
    let length = usize::from(u16::from_be_bytes([high, low]));
    if !b"VvMUOISP".contains(&kind) {
        return Err(format!("a frame of kind {kind}, which RTDE does not have"));
    }
    if length < HEADER {
        return Err(format!("a frame of {length} bytes, less than its own header"));
    }
    Ok(Some(length))
}

/// Kind and payload of a whole frame.
pub(in super::super) fn parts(frame: &[u8]) -> Option<(u8, &[u8])> {
    Some((*frame.get(2)?, frame.get(HEADER..)?))
}

/// A frame, or `None` where the payload is too long for one.
pub(in super::super) fn frame(kind: u8, payload: &[u8]) -> Option<Vec<u8>> {
    let length = u16::try_from(payload.len() + HEADER).ok()?;
    let mut frame = length.to_be_bytes().to_vec();
    frame.push(kind);
    frame.extend_from_slice(payload);
    Some(frame)
}

/// A value of RTDE.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum Value {
    Double(f64),
    Vector3([f64; 3]),
    Vector6([f64; 6]),
    Int6([i32; 6]),
    Int(i32),
    Uint(u32),
    Long(u64),
    Byte(u8),
    Bool(bool),
}

impl Value {
    /// The name of its type.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Double(_) => "DOUBLE",
            Self::Vector3(_) => "VECTOR3D",
            Self::Vector6(_) => "VECTOR6D",
            Self::Int6(_) => "VECTOR6INT32",
            Self::Int(_) => "INT32",
            Self::Uint(_) => "UINT32",
            Self::Long(_) => "UINT64",
            Self::Byte(_) => "UINT8",
            Self::Bool(_) => "BOOL",
        }
    }

    /// Appends its bytes.
    pub fn pack(&self, to: &mut Vec<u8>) {
        match self {
            Self::Double(v) => to.extend(v.to_be_bytes()),
            Self::Vector3(v) => to.extend(v.iter().flat_map(|v| v.to_be_bytes())),
            Self::Vector6(v) => to.extend(v.iter().flat_map(|v| v.to_be_bytes())),
            Self::Int6(v) => to.extend(v.iter().flat_map(|v| v.to_be_bytes())),
            Self::Int(v) => to.extend(v.to_be_bytes()),
            Self::Uint(v) => to.extend(v.to_be_bytes()),
            Self::Long(v) => to.extend(v.to_be_bytes()),
            Self::Byte(v) => to.push(*v),
            Self::Bool(v) => to.push(u8::from(*v)),
        }
    }
}

/// Takes big-endian numbers off the front of a payload; `None` past its end.
pub(in super::super) struct Reader<'a>(pub &'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*bytes)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.bytes().map(u8::from_be_bytes)
    }

    pub fn i32(&mut self) -> Option<i32> {
        self.bytes().map(i32::from_be_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.bytes().map(u32::from_be_bytes)
    }

    pub fn f64(&mut self) -> Option<f64> {
        self.bytes().map(f64::from_be_bytes)
    }

    pub fn vector6(&mut self) -> Option<[f64; 6]> {
        let mut vector = [0.0; 6];
        for v in &mut vector {
            *v = self.f64()?;
        }
        Some(vector)
    }
}
