//! Writes zips that say what they are told to, true or not.

use std::io::Write;

/// What a zip's directory or an entry's own header states of the entry.
#[derive(Clone)]
pub struct Stated {
    pub name: Vec<u8>,
    pub flags: u16,
    pub method: u16,
    pub crc: u32,
    pub packed: u64,
    pub unpacked: u64,
}

/// An entry.
#[derive(Clone)]
pub struct Entry {
    /// Bytes before it that belong to nothing.
    pub gap: Vec<u8>,
    /// What its own header states.
    pub local: Stated,
    /// What the directory states.
    pub central: Stated,
    pub data: Vec<u8>,
    /// Unix mode.
    pub mode: u32,
    /// Sizes in extra fields of eight bytes each.
    pub zip64: bool,
    /// A descriptor after the data instead of sizes in the header: with its signature or without.
    pub descriptor: Option<bool>,
    /// Where the directory says that it lies, if not where it does.
    pub offset: Option<u64>,
    /// No honest program would have written it.
    pub spoilt: bool,
}

impl Entry {
    pub fn new(name: &str, bytes: &[u8], deflated: bool) -> Entry {
        let data = if deflated { deflate(bytes) } else { bytes.to_vec() };
        let stated = Stated {
            name: name.as_bytes().to_vec(),
            flags: if name.is_ascii() { 0 } else { 1 << 11 },
            method: if deflated { 8 } else { 0 },
            crc: crc32fast::hash(bytes),
            packed: data.len() as u64,
            unpacked: bytes.len() as u64,
        };
        Entry {
            gap: Vec::new(),
            local: stated.clone(),
            central: stated,
            data,
            mode: 0o100_644,
            zip64: false,
            descriptor: None,
            offset: None,
            spoilt: false,
        }
    }

    /// Holds other bytes, honestly packed.
    pub fn put(&mut self, bytes: &[u8], deflated: bool) {
        let name = String::from_utf8_lossy(&self.central.name).into_owned();
        *self = Entry { spoilt: self.spoilt, ..Entry::new(&name, bytes, deflated) };
    }

    /// States something in both headers.
    pub fn state(&mut self, change: impl Fn(&mut Stated)) {
        change(&mut self.local);
        change(&mut self.central);
    }

    /// The bytes that it unpacks to.
    pub fn bytes(&self) -> Vec<u8> {
        if self.central.method != 8 {
            return self.data.clone();
        }
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut flate2::read::DeflateDecoder::new(&self.data[..]), &mut bytes)
            .unwrap();
        bytes
    }
}

pub fn deflate(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A zip.
#[derive(Clone, Default)]
pub struct Zip {
    pub entries: Vec<Entry>,
    /// Bytes between the last entry and the directory.
    pub gap: Vec<u8>,
    /// Bytes after the end.
    pub trailing: Vec<u8>,
    /// Added to the number of entries that the end states.
    pub miscount: i64,
    /// Added to the place of the directory that the end states.
    pub misplace: i64,
    /// Directory and end in their 64-bit forms.
    pub zip64: bool,
}

fn u16s(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn u32s(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn u64s(values: &[u64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

impl Zip {
    pub fn write(&self) -> Vec<u8> {
        let mut zip = Vec::new();
        let mut offsets = Vec::new();
        for entry in &self.entries {
            zip.extend(&entry.gap);
            offsets.push(entry.offset.unwrap_or(zip.len() as u64));
            write_local(&mut zip, entry);
        }
        zip.extend(&self.gap);
        let directory = zip.len() as u64;
        for (entry, offset) in self.entries.iter().zip(offsets) {
            write_central(&mut zip, entry, offset);
        }
        let size = zip.len() as u64 - directory;
        let count = self.entries.len().wrapping_add_signed(self.miscount as isize) as u64;
        let place = directory.wrapping_add_signed(self.misplace);
        if self.zip64 {
            let end = zip.len() as u64;
            zip.extend(b"PK\x06\x06");
            zip.extend(u64s(&[44]));
            zip.extend(u16s(&[45, 45]));
            zip.extend(u32s(&[0, 0]));
            zip.extend(u64s(&[count, count, size, place]));
            zip.extend(b"PK\x06\x07");
            zip.extend(u32s(&[0]));
            zip.extend(u64s(&[end]));
            zip.extend(u32s(&[1]));
            zip.extend(b"PK\x05\x06");
            zip.extend(u16s(&[0, 0, u16::MAX, u16::MAX]));
            zip.extend(u32s(&[u32::MAX, u32::MAX]));
        } else {
            zip.extend(b"PK\x05\x06");
            zip.extend(u16s(&[0, 0, count as u16, count as u16]));
            zip.extend(u32s(&[size as u32, place as u32]));
        }
        zip.extend(u16s(&[0]));
        zip.extend(&self.trailing);
        zip
    }
}

fn write_local(zip: &mut Vec<u8>, entry: &Entry) {
    let stated = &entry.local;
    let (crc, packed, unpacked) = match entry.descriptor {
        Some(_) => (0, 0, 0),
        None => (stated.crc, stated.packed, stated.unpacked),
    };
    let flags = stated.flags | if entry.descriptor.is_some() { 1 << 3 } else { 0 };
    let extra = if entry.zip64 { [u16s(&[1, 16]), u64s(&[unpacked, packed])].concat() } else { Vec::new() };
    let short = |size: u64| if entry.zip64 { u32::MAX } else { size as u32 };
    zip.extend(b"PK\x03\x04");
    zip.extend(u16s(&[20, flags, stated.method, 0, 0x21]));
    zip.extend(u32s(&[crc, short(packed), short(unpacked)]));
    zip.extend(u16s(&[stated.name.len() as u16, extra.len() as u16]));
    zip.extend(&stated.name);
    zip.extend(extra);
    zip.extend(&entry.data);
    if let Some(signed) = entry.descriptor {
        if signed {
            zip.extend(b"PK\x07\x08");
        }
        zip.extend(u32s(&[stated.crc]));
        if entry.zip64 {
            zip.extend(u64s(&[stated.packed, stated.unpacked]));
        } else {
            zip.extend(u32s(&[stated.packed as u32, stated.unpacked as u32]));
        }
    }
}

fn write_central(zip: &mut Vec<u8>, entry: &Entry, offset: u64) {
    let stated = &entry.central;
    let flags = stated.flags | if entry.descriptor.is_some() { 1 << 3 } else { 0 };
    let extra = if entry.zip64 {
        [u16s(&[1, 24]), u64s(&[stated.unpacked, stated.packed, offset])].concat()
    } else {
        Vec::new()
    };
    let short = |value: u64| if entry.zip64 { u32::MAX } else { value as u32 };
    zip.extend(b"PK\x01\x02");
    zip.extend(u16s(&[3 << 8 | 20, 20, flags, stated.method, 0, 0x21]));
    zip.extend(u32s(&[stated.crc, short(stated.packed), short(stated.unpacked)]));
    zip.extend(u16s(&[stated.name.len() as u16, extra.len() as u16, 0, 0, 0]));
    zip.extend(u32s(&[entry.mode << 16, short(offset)]));
    zip.extend(&stated.name);
    zip.extend(extra);
}
