//! The grammar's words: faults, each at a place drawn at random.

use super::case::{Case, Random};
use super::common::SIZE;
use super::png_writer::{self as png, Header};
use super::zip_writer::{Entry, Stated};

/// A way to go wrong.
pub struct Fault {
    pub name: &'static str,
    /// What is told of it, at least one of these.
    pub codes: &'static [&'static str],
    /// What else may be told.
    pub also: &'static [&'static str],
    pub apply: fn(&mut Case, &mut Random),
}

const fn fault(
    name: &'static str,
    codes: &'static [&'static str],
    also: &'static [&'static str],
    apply: fn(&mut Case, &mut Random),
) -> Fault {
    Fault { name, codes, also, apply }
}

/// The place of an entry that is as it should be, until now: what one fault does, no other undoes.
fn sound(case: &mut Case, random: &mut Random) -> usize {
    let entries = &mut case.zip.entries;
    let sound: Vec<usize> = (0..entries.len()).filter(|&n| !entries[n].spoilt).collect();
    let n = random.one(&sound);
    entries[n].spoilt = true;
    n
}

fn any<'a>(case: &'a mut Case, random: &mut Random) -> &'a mut Entry {
    let n = sound(case, random);
    &mut case.zip.entries[n]
}

/// Renames an entry in both of its headers.
fn rename(case: &mut Case, random: &mut Random, name: impl Fn(&str) -> Vec<u8>) {
    let entry = any(case, random);
    let new = name(&String::from_utf8_lossy(&entry.central.name.clone()));
    entry.state(|stated| stated.name = new.clone());
}

/// Adds an entry that nobody asked for.
fn add(case: &mut Case, random: &mut Random, name: &str) {
    let place = random.below(case.zip.entries.len() + 1);
    let bytes = random.bytes(30);
    case.zip.entries.insert(place, Entry { spoilt: true, ..Entry::new(name, &bytes, false) });
}

/// Replaces an entry's bytes by others, honestly packed.
fn put(case: &mut Case, random: &mut Random, bytes: &[u8]) {
    let entry = any(case, random);
    entry.put(bytes, entry.central.method == 8);
}

/// Replaces an entry's bytes by what becomes of them.
fn change(case: &mut Case, random: &mut Random, change: impl Fn(Vec<u8>, &mut Random) -> Vec<u8>) {
    let entry = any(case, random);
    let bytes = change(entry.bytes(), random);
    entry.put(&bytes, entry.central.method == 8);
}

/// An entry that is deflated.
fn deflated<'a>(case: &'a mut Case, random: &mut Random) -> &'a mut Entry {
    let entry = any(case, random);
    if entry.central.method != 8 {
        entry.put(&entry.bytes(), true);
    }
    entry
}

const RGB: Header = Header { size: SIZE, depth: 8, colour: 2, interlace: 0 };

/// An image with another header, and pixels that fit it.
fn with_header(case: &mut Case, random: &mut Random, header: Header) {
    let palette = if header.colour == 3 { png::chunk(b"PLTE", &[9; 6]) } else { Vec::new() };
    put(case, random, &png::file(header, &[palette, png::pixels(header)]));
}

fn both(case: &mut Case, random: &mut Random, lie: impl Fn(&mut Stated)) {
    any(case, random).state(lie);
}

const MISSING: &[&str] = &["missing-image", "no-images"];
const STRUCTURE: &[&str] = &[
    "missing-image",
    "no-images",
    "overlapping-entries",
    "hidden-data",
    "header-mismatch",
    "zip-damaged",
    "size-mismatch",
];

pub const FAULTS: &[Fault] = &[
    // The zip as a whole.
    fault("random bytes", &["not-a-zip"], &[], |case, random| case.instead = Some(random.bytes(3000))),
    fault("no bytes", &["not-a-zip"], &[], |case, _| case.instead = Some(Vec::new())),
    fault("an image instead of a zip", &["not-a-zip"], &[], |case, _| {
        case.instead = Some(png::file(RGB, &[png::pixels(RGB)]));
    }),
    fault("cut off", &["not-a-zip", "zip-damaged"], STRUCTURE, |case, random| {
        case.kept = Some(random.below(1000));
    }),
    fault("bytes before", &["hidden-data"], &[], |case, random| case.zip.entries[0].gap = random.bytes(7)),
    fault("bytes between", &["hidden-data"], &[], |case, random| any(case, random).gap = vec![3; 90]),
    fault("bytes before the directory", &["hidden-data"], &[], |case, random| {
        case.zip.gap = random.bytes(12);
    }),
    fault("bytes after", &["hidden-data"], &[], |case, _| case.zip.trailing = vec![1; 50]),
    fault("an archive after the archive", &["hidden-data"], STRUCTURE, |case, _| {
        let mut second = case.zip.clone();
        second.entries.truncate(1);
        case.zip.entries[0].gap = second.write();
    }),
    fault("counts too many", &["zip-damaged"], &[], |case, random| {
        case.zip.miscount = 1 + random.below(50) as i64;
    }),
    fault("counts too few", &["zip-damaged"], &[], |case, _| case.zip.miscount = -1),
    fault("directory elsewhere", &["zip-damaged"], STRUCTURE, |case, random| {
        case.zip.misplace = random.one(&[-46, -1, 1, 30, 100_000]);
    }),
    fault("too many bytes", &["zip-too-large"], &[], |case, _| case.limits.zip_bytes = 100),
    fault("too many entries", &["too-many-entries"], MISSING, |case, random| {
        case.limits.entries = 1 + random.below(case.zip.entries.len() - 1);
    }),
    fault("too many entries and a lie about it", &["too-many-entries"], MISSING, |case, _| {
        case.limits.entries = case.zip.entries.len() - 1;
        case.zip.miscount = -2;
    }),
    fault("too much in all", &["total-too-large"], &[], |case, _| case.limits.total_bytes = 1000),
    fault("empty", &["no-images"], &["zip-damaged"], |case, _| case.zip.entries.clear()),
    // Which entries there are.
    fault("missing", MISSING, &[], |case, random| {
        let n = sound(case, random);
        case.zip.entries.remove(n);
    }),
    fault("twice", &["duplicate-name"], &[], |case, random| {
        let entry = any(case, random).clone();
        case.zip.entries.push(entry);
    }),
    fault("surplus", &["unexpected-entry"], &[], |case, random| {
        let names = [
            "box_99_99.png",
            "notes.txt",
            "nested.zip",
            "box_00_00.jpg",
            ".DS_Store",
            "",
            "\u{0}",
            "box_0_0.png",
        ];
        let name = random.one(&names);
        add(case, random, name);
    }),
    fault("a very long name", &["unexpected-entry"], &[], |case, random| {
        add(case, random, &"long".repeat(12_000));
    }),
    fault("capitals", &["name-spelling"], MISSING, |case, random| {
        rename(case, random, |name| name.to_uppercase().into_bytes());
    }),
    fault("capitals beside", &["name-spelling"], &[], |case, random| {
        let name = String::from_utf8_lossy(&any(case, random).central.name).to_uppercase();
        add(case, random, &name);
    }),
    fault("decomposed letters", &["name-spelling"], &[], |case, random| {
        let names = case.zip.entries.iter().map(|entry| String::from_utf8_lossy(&entry.central.name));
        let name = names.into_iter().find(|name| name.contains('é')).unwrap_or("café_00_04.png".into());
        let name = name.replace('é', "e\u{301}");
        add(case, random, &name);
    }),
    fault("up", &["path-traversal"], MISSING, |case, random| {
        rename(case, random, |name| format!("../{name}").into_bytes());
    }),
    fault("down and up", &["path-traversal"], &[], |case, random| {
        let name = random.one(&["a/../../b.png", "..\\b.png", "a\\..\\..\\b.png", "..", "a/.."]);
        add(case, random, name);
    }),
    fault("absolute", &["absolute-path"], &[], |case, random| {
        let name = random.one(&["/etc/passwd", "C:\\b.png", "\\\\server\\b.png", "c:b.png", "//b.png"]);
        add(case, random, name);
    }),
    fault("in a folder", &["in-folder"], MISSING, |case, random| {
        rename(case, random, |name| format!("results/{name}").into_bytes());
    }),
    fault("a folder", &["in-folder"], &[], |case, random| {
        let name = random.one(&["results/", "__MACOSX/._box_00_00.png", "a\\b.png", "./b.png"]);
        add(case, random, name);
    }),
    fault("not UTF-8", &["name-encoding"], MISSING, |case, random| {
        rename(case, random, |name| [name.as_bytes(), b"\xe9\xff"].concat());
    }),
    fault("a link", &["symlink"], &[], |case, random| any(case, random).mode = 0o120_777),
    fault("a device", &["special-file"], &[], |case, random| {
        let mode = random.one(&[0o010_644, 0o020_644, 0o060_644, 0o140_755]);
        any(case, random).mode = mode;
    }),
    // How entries are packed.
    fault("encrypted", &["encrypted"], &[], |case, random| {
        let flag = random.one(&[1, 1 | 1 << 6, 1 | 1 << 13]);
        both(case, random, |stated| stated.flags |= flag);
    }),
    fault("encrypted by its own account", &["encrypted"], &["header-mismatch"], |case, random| {
        any(case, random).local.flags |= 1;
    }),
    fault("packed otherwise", &["compression-method"], STRUCTURE, |case, random| {
        let method = random.one(&[1, 6, 9, 12, 14, 93, 95, 99]);
        both(case, random, |stated| stated.method = method);
    }),
    fault("two names", &["header-mismatch"], &[], |case, random| any(case, random).local.name[0] ^= 1),
    fault("two checksums", &["header-mismatch"], &["hidden-data"], |case, random| {
        any(case, random).local.crc ^= 1
    }),
    fault("two sizes", &["header-mismatch"], &["hidden-data"], |case, random| {
        any(case, random).local.unpacked ^= 1
    }),
    fault("two methods", &["header-mismatch"], &[], |case, random| any(case, random).local.method ^= 8),
    fault("unpacks to more than stated", &["size-mismatch"], &[], |case, random| {
        deflated(case, random).state(|stated| stated.unpacked = stated.unpacked.wrapping_sub(1));
    }),
    fault("unpacks to less than stated", &["size-mismatch"], &[], |case, random| {
        deflated(case, random).state(|stated| stated.unpacked = stated.unpacked.wrapping_add(9));
    }),
    fault("stored with two sizes", &["size-mismatch"], &[], |case, random| {
        let entry = any(case, random);
        entry.put(&entry.bytes(), false);
        entry.state(|stated| stated.unpacked = stated.unpacked.wrapping_add(3));
    }),
    fault(
        "states too few packed bytes",
        &["hidden-data"],
        &["size-mismatch", "header-mismatch"],
        |case, random| {
            both(case, random, |stated| stated.packed = stated.packed.wrapping_sub(5));
        },
    ),
    fault(
        "states too many packed bytes",
        &["overlapping-entries", "header-mismatch"],
        &["size-mismatch", "header-mismatch", "hidden-data", "ratio"],
        |case, random| {
            let more = random.one(&[1, 40, 1 << 20, 1 << 31]);
            both(case, random, |stated| stated.packed = stated.packed.wrapping_add(more));
        },
    ),
    fault(
        "two entries in one place",
        &["overlapping-entries"],
        &["header-mismatch", "hidden-data", "zip-damaged"],
        |case, _| {
            let n = case.zip.entries.len();
            case.zip.entries[n - 1].offset = Some(0);
        },
    ),
    fault("beyond the zip", &["zip-damaged"], STRUCTURE, |case, random| {
        let offset = random.one(&[u64::from(u32::MAX) - 1, 1 << 30]);
        any(case, random).offset = Some(offset);
    }),
    fault("beyond all zips", &["zip-damaged"], STRUCTURE, |case, random| {
        let offset = random.one(&[u64::MAX, u64::MAX - 20, 1 << 63, 1 << 40]);
        let entry = any(case, random);
        (entry.offset, entry.zip64) = (Some(offset), true);
    }),
    fault(
        "states a huge size",
        &["entry-too-large"],
        &["ratio", "size-mismatch", "total-too-large"],
        |case, random| {
            let size = random.one(&[1 << 22, 1 << 30, 1 << 40, u64::MAX, 1 << 63]);
            let entry = any(case, random);
            entry.zip64 = true;
            entry.state(|stated| stated.unpacked = size);
        },
    ),
    fault("sizes lie in 64 bits", &["header-mismatch"], STRUCTURE, |case, random| {
        let entry = any(case, random);
        entry.zip64 = true;
        entry.local.packed = u64::MAX;
    }),
    fault("a bomb", &["entry-too-large"], &["ratio"], |case, random| put_deflated(case, random, 3 << 20)),
    fault("a small bomb", &["ratio"], &[], |case, random| put_deflated(case, random, 300_000)),
    fault("a bomb that lies", &["size-mismatch"], &[], |case, random| {
        put_deflated(case, random, 3 << 20);
        for entry in case.zip.entries.iter_mut().filter(|entry| entry.central.unpacked == 3 << 20) {
            entry.state(|stated| stated.unpacked = 700);
        }
    }),
    fault("bytes after the packed ones", &["hidden-data"], &[], |case, random| {
        let entry = deflated(case, random);
        entry.data.extend([7; 20]);
        entry.state(|stated| stated.packed = stated.packed.wrapping_add(20));
    }),
    fault(
        "packed bytes damaged",
        &["packed-damaged", "checksum-mismatch", "size-mismatch", "hidden-data"],
        &[],
        |case, random| {
            let at = random.next() as usize;
            let entry = deflated(case, random);
            let at = at % entry.data.len();
            entry.data[at] ^= 0x5a;
        },
    ),
    fault("stored bytes damaged", &["checksum-mismatch"], &[], |case, random| {
        let at = random.next() as usize;
        let entry = any(case, random);
        entry.put(&entry.bytes(), false);
        let at = at % entry.data.len();
        entry.data[at] ^= 1;
    }),
    fault("not packed at all", &["packed-damaged"], &[], |case, random| {
        let entry = any(case, random);
        entry.put(&[0xff; 600], false);
        entry.state(|stated| stated.method = 8);
    }),
    fault("wrong checksum", &["checksum-mismatch"], &[], |case, random| {
        both(case, random, |stated| stated.crc ^= 0x10);
    }),
    // What the images are.
    fault("another format", &["not-png"], &[], |case, random| {
        let begin: &[u8] = random.one(&[
            b"\xff\xd8\xff\xe0",
            b"GIF89a",
            b"PK\x03\x04",
            b"BM",
            b"RIFF____WEBP",
            b"",
            b"\x89PNG\n",
            b"II*\0",
            b"<svg>",
        ]);
        put(case, random, begin);
    }),
    fault("an image cut off", &["png-truncated", "not-png"], &[], |case, random| {
        change(case, random, |bytes, random| bytes[..random.below(bytes.len())].to_vec());
    }),
    fault("a part longer than the file", &["png-truncated"], &[], |case, random| {
        change(case, random, |mut bytes, _| {
            bytes[33] = 0xff;
            bytes
        });
    }),
    fault("a part damaged", &["png-checksum"], &[], |case, random| {
        change(case, random, |mut bytes, random| {
            let at = random.one(&[17, 25, 29, 45]);
            bytes[at] ^= 2;
            bytes
        });
    }),
    fault("bytes after the image", &["png-trailing-data"], &[], |case, random| {
        change(case, random, |bytes, random| [bytes, random.bytes(40)].concat());
    }),
    fault("wrong size", &["wrong-size"], &[], |case, random| {
        let size = random.one(&[(12, 16), (16, 11), (1, 1), (32, 24)]);
        with_header(case, random, Header { size, ..RGB });
    }),
    fault("a size beyond all limits", &["too-many-pixels"], &["wrong-size"], |case, random| {
        let size = random.one(&[(1 << 31, 1 << 31), (65_535, 65_535), (u32::MAX, u32::MAX), (1 << 27, 1)]);
        put(case, random, &png::file(Header { size, ..RGB }, &[png::pixels(RGB)]));
    }),
    fault("no size", &["wrong-size"], &[], |case, random| {
        put(case, random, &png::file(Header { size: (0, 12), ..RGB }, &[png::pixels(RGB)]));
    }),
    fault("sixteen bits", &["png-bit-depth"], &[], |case, random| {
        with_header(case, random, Header { depth: 16, ..RGB });
    }),
    fault("a palette", &["png-palette"], &["png-bit-depth"], |case, random| {
        let depth = random.one(&[1, 2, 4, 8]);
        with_header(case, random, Header { depth, colour: 3, ..RGB });
    }),
    fault("grey", &["png-grey"], &["png-bit-depth"], |case, random| {
        let depth = random.one(&[1, 2, 4, 8, 16]);
        with_header(case, random, Header { depth, colour: 0, ..RGB });
    }),
    fault("transparent", &["png-alpha"], &["png-grey", "png-bit-depth"], |case, random| {
        let (colour, depth) = random.one(&[(4, 8), (6, 8), (6, 16)]);
        with_header(case, random, Header { colour, depth, ..RGB });
    }),
    fault("a transparent colour", &["png-alpha"], &[], |case, random| {
        put(case, random, &png::file(RGB, &[png::chunk(b"tRNS", &[0; 6]), png::pixels(RGB)]));
    }),
    fault("interlaced", &["png-interlaced"], &[], |case, random| {
        with_header(case, random, Header { interlace: 1, ..RGB });
    }),
    fault("animated", &["png-animated"], &[], |case, random| {
        put(
            case,
            random,
            &png::file(RGB, &[png::chunk(b"acTL", &[0, 0, 0, 2, 0, 0, 0, 0]), png::pixels(RGB)]),
        );
    }),
    fault("no such header", &["png-damaged"], &[], |case, random| {
        let header = random.one(&[
            Header { colour: 5, ..RGB },
            Header { depth: 3, ..RGB },
            Header { interlace: 7, ..RGB },
        ]);
        put(case, random, &png::file(header, &[png::pixels(RGB)]));
    }),
    fault("parts out of order", &["png-damaged"], &[], |case, random| {
        let (pixels, header) = (png::pixels(RGB), RGB.chunk());
        let text = png::chunk(b"tEXt", b"a\0b");
        let middle = match random.below(5) {
            0 => vec![],
            1 => vec![header, pixels],
            2 => vec![pixels.clone(), text, pixels],
            3 => vec![png::chunk(b"XyZW", b"a"), pixels],
            _ => vec![png::chunk(b"a1b2", b"a"), pixels],
        };
        put(case, random, &png::file(RGB, &middle));
    }),
    fault("pixels that are none", &["png-damaged"], &[], |case, random| {
        let row = 1 + 3 * SIZE.0 as usize;
        let pixels = match random.below(4) {
            0 => random.bytes(400),
            1 => png::zlib(&vec![0; row * (SIZE.1 as usize - 1)]),
            2 => png::zlib(&vec![9; row * SIZE.1 as usize]),
            _ => Vec::new(),
        };
        put(case, random, &png::file(RGB, &[png::chunk(b"IDAT", &pixels)]));
    }),
    fault("a header of the wrong length", &["png-damaged"], &[], |case, random| {
        let bytes = [png::SIGNATURE, &png::chunk(b"IHDR", &[0; 12]), &png::chunk(b"IEND", &[])].concat();
        put(case, random, &bytes);
    }),
];

fn put_deflated(case: &mut Case, random: &mut Random, zeros: usize) {
    any(case, random).put(&vec![0; zeros], true);
}
