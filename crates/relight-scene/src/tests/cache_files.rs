use std::fs;
use std::path::Path;

use crate::cache_file::{CacheEntry, CacheKind};

const KIND: CacheKind = CacheKind { magic: *b"TESTTEST", version: 3, ending: "test" };

fn entry(folder: &Path, kind: CacheKind, things: &str) -> CacheEntry {
    CacheEntry::new(kind, folder, "a name", "place\n", things)
}

#[test]
fn contents_come_back_for_the_same_things_alone() {
    let folder = tempfile::tempdir().unwrap();
    let first = entry(folder.path(), KIND, "things");
    for contents in [&b""[..], b"contents", &[7; 10_000]] {
        first.write(contents).unwrap();
        assert_eq!(first.read().unwrap(), contents);
        assert_eq!(entry(folder.path(), KIND, "things").read().unwrap(), contents, "at the next start");
        let others = [
            entry(folder.path(), KIND, "thinks"),
            entry(folder.path(), KIND, "thing"),
            entry(folder.path(), KIND, "things\0"),
            entry(folder.path(), CacheKind { version: 4, ..KIND }, "things"),
            entry(folder.path(), CacheKind { magic: *b"TESTTESU", ..KIND }, "things"),
        ];
        for other in others {
            assert_eq!(other.path(), first.path());
            assert_eq!(other.read(), None, "{other:?}");
        }
    }
    entry(folder.path(), KIND, "other things").write(b"other contents").unwrap();
    assert_eq!(first.read(), None);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "stale files are replaced");
}

#[test]
fn what_lies_beside_hangs_on_the_same_things() {
    let folder = tempfile::tempdir().unwrap();
    let other_kind = CacheKind { magic: *b"OTHERONE", version: 1, ending: "other" };
    let first = entry(folder.path(), KIND, "things");
    let beside = first.beside(other_kind, "more");
    assert_eq!(beside.path(), first.path().with_extension("other"));
    beside.write(b"contents").unwrap();
    assert_eq!(first.read(), None);
    assert_eq!(entry(folder.path(), KIND, "things").beside(other_kind, "more").read().unwrap(), b"contents");
    assert_eq!(first.beside(other_kind, "less").read(), None);
    assert_eq!(entry(folder.path(), KIND, "others").beside(other_kind, "more").read(), None);
}

#[test]
fn damaged_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let entry = entry(folder.path(), KIND, "things");
    assert_eq!(entry.read(), None, "no file");
    entry.write(b"contents").unwrap();
    let whole = fs::read(entry.path()).unwrap();
    for length in 0..whole.len() {
        fs::write(entry.path(), &whole[..length]).unwrap();
        assert_eq!(entry.read(), None, "{length} bytes");
    }
    for at in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << (at % 8);
        fs::write(entry.path(), flipped).unwrap();
        assert_eq!(entry.read(), None, "byte {at}");
    }
    fs::write(entry.path(), [&whole[..], b"more"].concat()).unwrap();
    assert_eq!(entry.read(), None, "longer");
    fs::write(entry.path(), whole).unwrap();
    assert_eq!(entry.read().unwrap(), b"contents");

    fs::remove_file(entry.path()).unwrap();
    fs::create_dir(entry.path()).unwrap();
    assert_eq!(entry.read(), None, "a folder");
    assert!(entry.write(b"contents").is_err());
    let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(names, [entry.path()], "nothing unfinished is left");
}
