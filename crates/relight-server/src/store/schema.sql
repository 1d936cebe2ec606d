-- Times are milliseconds since 1970 (UTC). Whatever a page shows of a submission, a benchmark or a user moves `revision`.

CREATE TABLE settings (
    key TEXT PRIMARY KEY,
    value TEXT NOT NULL
) STRICT;

CREATE TABLE users (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name TEXT NOT NULL COLLATE NOCASE UNIQUE,
    email TEXT NOT NULL COLLATE NOCASE UNIQUE,
    password TEXT,
    status TEXT NOT NULL CHECK (status IN ('active', 'waiting', 'blocked')),
    created_at INTEGER NOT NULL,
    is_admin INTEGER NOT NULL DEFAULT 0
) STRICT;

CREATE TABLE tokens (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    user INTEGER NOT NULL REFERENCES users (id),
    name TEXT NOT NULL,
    hash BLOB NOT NULL,
    created_at INTEGER NOT NULL,
    used_at INTEGER,
    revoked_at INTEGER
) STRICT;
CREATE INDEX tokens_of_user ON tokens (user);

CREATE TABLE sessions (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    user INTEGER NOT NULL REFERENCES users (id),
    hash BLOB NOT NULL,
    expires_at INTEGER NOT NULL
) STRICT;
CREATE INDEX sessions_of_user ON sessions (user);

CREATE TABLE benchmarks (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name TEXT NOT NULL UNIQUE,
    folder TEXT NOT NULL,
    scenes TEXT NOT NULL,
    open INTEGER NOT NULL DEFAULT 1,
    val_per_day INTEGER NOT NULL,
    val_total INTEGER NOT NULL,
    val_gap_seconds INTEGER NOT NULL,
    test_per_day INTEGER NOT NULL,
    test_total INTEGER NOT NULL,
    test_gap_seconds INTEGER NOT NULL,
    added_at INTEGER NOT NULL
) STRICT;

CREATE TABLE submissions (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    benchmark INTEGER NOT NULL REFERENCES benchmarks (id),
    user INTEGER NOT NULL REFERENCES users (id),
    phase TEXT NOT NULL CHECK (phase IN ('val', 'test')),
    visibility TEXT NOT NULL CHECK (visibility IN ('public', 'anonymous', 'private')),
    method TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    bytes INTEGER NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('queued', 'scoring', 'scored', 'refused')),
    -- Whether it takes from its user's quota: not if it was refused.
    counted INTEGER NOT NULL DEFAULT 1,
    submitted_at INTEGER NOT NULL,
    not_before INTEGER NOT NULL DEFAULT 0,
    failures INTEGER NOT NULL DEFAULT 0,
    finished_at INTEGER,
    reason TEXT,
    problems TEXT,
    scores TEXT,
    receipt TEXT,
    hidden INTEGER NOT NULL DEFAULT 0,
    pinned INTEGER NOT NULL DEFAULT 0,
    withdrawn_at INTEGER,
    CHECK ((state = 'scored') = (scores IS NOT NULL)),
    CHECK ((scores IS NULL) = (receipt IS NULL)),
    CHECK (state <> 'refused' OR (reason IS NOT NULL AND counted = 0))
) STRICT;
CREATE INDEX submissions_of_user ON submissions (user, benchmark, phase, submitted_at);
CREATE INDEX submissions_of_benchmark ON submissions (benchmark, state);
CREATE INDEX submissions_waiting ON submissions (state, not_before) WHERE state IN ('queued', 'scoring');

-- A score is written once.
CREATE TRIGGER scores_stay BEFORE UPDATE OF scores, receipt, state ON submissions
WHEN OLD.state IN ('scored', 'refused') AND (NEW.state IS NOT OLD.state OR NEW.scores IS NOT OLD.scores OR NEW.receipt IS NOT OLD.receipt)
BEGIN
    SELECT RAISE(ABORT, 'a finished submission does not change');
END;

CREATE TABLE audit (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    at INTEGER NOT NULL,
    actor TEXT NOT NULL,
    action TEXT NOT NULL,
    subject TEXT NOT NULL,
    detail TEXT NOT NULL
) STRICT;
CREATE TRIGGER audit_stays BEFORE UPDATE ON audit BEGIN SELECT RAISE(ABORT, 'the audit log only grows'); END;
CREATE TRIGGER audit_is_kept BEFORE DELETE ON audit BEGIN SELECT RAISE(ABORT, 'the audit log only grows'); END;

CREATE TABLE revision (value INTEGER NOT NULL) STRICT;
INSERT INTO revision VALUES (0);
CREATE TRIGGER submissions_added AFTER INSERT ON submissions BEGIN UPDATE revision SET value = value + 1; END;
CREATE TRIGGER submissions_changed AFTER UPDATE ON submissions BEGIN UPDATE revision SET value = value + 1; END;
CREATE TRIGGER benchmarks_added AFTER INSERT ON benchmarks BEGIN UPDATE revision SET value = value + 1; END;
CREATE TRIGGER benchmarks_changed AFTER UPDATE ON benchmarks BEGIN UPDATE revision SET value = value + 1; END;
CREATE TRIGGER users_changed AFTER UPDATE ON users BEGIN UPDATE revision SET value = value + 1; END;
