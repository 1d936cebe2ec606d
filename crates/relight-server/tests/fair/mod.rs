//! A server with users and entries of every kind, whose scores are made up.

// Each test uses a part of it, outside of test functions.
#![allow(dead_code, clippy::unwrap_used)]

use std::sync::Arc;

use axum::body::Body;
use axum::http::{Request, Response, StatusCode, header};
use relight_field::random::Random;
use relight_scene::{Image, Split};
use relight_server::accounts;
use relight_server::app::{App, AppState, Settings, router};
use relight_server::disclosure::tell;
use relight_server::method::{Method, Phase, Visibility};
use relight_server::receipt::Receipt;
use relight_server::scoring::{ImageScore, Scores};
use relight_server::store::{NewSubmission, Quota, SceneEntry, User, Verdict};
use relight_server::submission::{Code, Problem, Refusal};
use relight_server::time::Time;
use relight_server::worker::pictures::{Picture, file_name};
use tempfile::TempDir;
use tower::ServiceExt;

/// The scenes of the official release.
pub const SCENES: [&str; 20] = [
    "apple",
    "cheetah",
    "cube",
    "dinosaurs",
    "flipflop",
    "fruits",
    "garden",
    "helicopters",
    "kittens",
    "lego",
    "lunch",
    "plant",
    "reflective",
    "robotoy",
    "savannah",
    "shark",
    "stegosaurus",
    "tapes",
    "trucks",
    "wooden",
];

/// Names that do harm where they are not escaped.
pub const HOSTILE: [&str; 5] = [
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>",
    "'; DROP TABLE submissions; -- & </title></style>",
    "שיטה חדשה للإضاءة",
    "🔦💡 ｗｉｄｅ Ünïcödé",
];

/// The server.
pub struct Fair {
    pub folder: TempDir,
    pub app: AppState,
    pub ada: User,
    /// What Ada's browser keeps.
    pub cookie: String,
}

impl Fair {
    /// With a user and a benchmark and nothing else. Quotas and rates are beyond what tests ask for.
    pub async fn new() -> Fair {
        let folder = tempfile::tempdir().unwrap();
        let rate = 1_000_000.try_into().unwrap();
        let app = App::open(folder.path(), Settings { requests_per_second: rate, ..Settings::default() })
            .await
            .unwrap();
        let ada = accounts::sign_up(&app.store, "Ada Lovelace", "lovelace@example.org", "analytical engine")
            .await
            .unwrap();
        let scene = |name: &&str| SceneEntry {
            name: (*name).to_owned(),
            val: 9,
            easy: 111,
            hard: 9,
            width: 1440,
            height: 1080,
        };
        let scenes: Vec<SceneEntry> = SCENES.iter().map(scene).collect();
        app.store.add_benchmark("rene", folder.path(), &scenes).await.unwrap();
        for phase in [Phase::Val, Phase::Test] {
            let quota = Quota { per_day: 1000, total: 1000, gap_seconds: 0 };
            app.store.set_quota("rene", phase, quota, "admin").await.unwrap();
        }
        let cookie = format!("relight_session={}", accounts::new_session(&app.store, &ada).await.unwrap());
        Fair { folder, app, ada, cookie }
    }

    /// With entries by the names of methods, better and better, besides a baseline, a validation entry and a refused one.
    pub async fn with(names: &[&str]) -> Fair {
        let fair = Fair::new().await;
        for (index, name) in names.iter().enumerate() {
            let method = Method {
                name: (*name).to_owned(),
                authors: format!("A. Author, B. Builder of {name}"),
                description: format!("What {name} does.\n\nIn two paragraphs."),
                paper: "https://example.org/paper?a=1&b=2".into(),
                code: "https://example.org/code".into(),
                hardware: "one RTX 4090".into(),
                training_time: "20 min".into(),
            };
            let visibility = if index % 5 == 3 { Visibility::Anonymous } else { Visibility::Public };
            fair.scored(&format!("{index:04x}"), method, Phase::Test, visibility, 22.0 + index as f64 * 0.37)
                .await;
        }
        let named = |name: &str| Method { name: name.into(), ..Method::default() };
        fair.scored("ba5e", named("mean image"), Phase::Test, Visibility::Public, 17.3).await;
        fair.app.store.set_pinned("ba5e", true).await.unwrap();
        fair.scored("5a1", named(names.first().unwrap_or(&"first")), Phase::Val, Visibility::Public, 25.0)
            .await;
        fair.refused("bad", named(names.last().unwrap_or(&"last"))).await;
        fair
    }

    async fn claimed(&self, id: &str, method: Method, phase: Phase, visibility: Visibility) {
        let new = NewSubmission {
            id: id.into(),
            benchmark: "rene".into(),
            phase,
            visibility,
            method,
            sha256: "5f".repeat(32),
            bytes: 1_234_567_890,
        };
        self.app.store.submit(&new, self.ada.id, Time::now()).await.unwrap();
        assert_eq!(self.app.store.claim(false, Time::now()).await.unwrap().unwrap().id, id);
    }

    /// Adds an entry with made-up scores around a PSNR, and pictures where there are validation images.
    pub async fn scored(&self, id: &str, method: Method, phase: Phase, visibility: Visibility, psnr: f64) {
        self.claimed(id, method.clone(), phase, visibility).await;
        let scores = made_up(id, phase, psnr);
        if phase == Phase::Val {
            self.draw(id, &scores);
        }
        let receipt = Receipt {
            format: "relight-receipt-1".into(),
            submission: id.into(),
            benchmark: "rene".into(),
            method: method.name,
            sha256: "5f".repeat(32),
            submitted_at: Time::now().to_string(),
            scored_at: Time::now().to_string(),
            evaluator: scores.evaluator.clone(),
            scores: tell(&scores),
            public_key: self.app.key.public(),
            signature: String::new(),
        };
        let verdict = Verdict::Scored { scores: Box::new(scores), receipt: Box::new(receipt), phase };
        self.app.store.finish(id, &verdict, Time::now()).await.unwrap();
    }

    async fn refused(&self, id: &str, method: Method) {
        let name = method.name.clone();
        self.claimed(id, method, Phase::Test, Visibility::Private).await;
        let problem =
            Problem { code: Code::WrongSize, entry: Some(name.clone()), message: "is 720x540".into() };
        let verdict = Verdict::Refused {
            reason: format!("{name}: is 720x540"),
            problems: Some(Refusal { problems: vec![problem], more: 7 }),
        };
        self.app.store.finish(id, &verdict, Time::now()).await.unwrap();
    }

    /// Three small pictures of the first validation image of each scene.
    fn draw(&self, id: &str, scores: &Scores) {
        let folder = self.app.folder.pictures_of(id);
        std::fs::create_dir_all(&folder).unwrap();
        for scene in SCENES {
            let image =
                scores.images.iter().find(|image| image.scene == scene && image.split == Split::Val).unwrap();
            for (picture, tint) in [(Picture::Submitted, 40), (Picture::Truth, 90), (Picture::Error, 0)] {
                let pixel = |i: u32| {
                    let (x, y) = (i % 144, i / 144);
                    let inside = (x as i32 - 72).pow(2) + (y as i32 - 54).pow(2) < 40 * 40;
                    [x as u8 + tint, if inside { 160 } else { y as u8 }, if inside { tint } else { 70 }]
                };
                let image_of =
                    Image { width: 144, height: 108, data: (0..144 * 108).flat_map(pixel).collect() };
                let path = folder.join(file_name(scene, image.light, image.camera, picture));
                std::fs::write(path, image_of.png().unwrap()).unwrap();
            }
        }
    }

    /// The answer to a request.
    pub async fn send(&self, request: Request<Body>) -> Response<Body> {
        router(Arc::clone(&self.app)).oneshot(request).await.unwrap()
    }

    /// Status and text of an address, as Ada sees it or as anyone.
    pub async fn get(&self, address: &str, as_ada: bool) -> (StatusCode, String) {
        let mut request = Request::get(address);
        if as_ada {
            request = request.header(header::COOKIE, &self.cookie);
        }
        text(self.send(request.body(Body::empty()).unwrap()).await).await
    }

    /// Status and text of what Ada's browser gets for a form.
    pub async fn post(&self, address: &str, form: &str) -> (StatusCode, String) {
        let request = Request::post(address)
            .header(header::COOKIE, &self.cookie)
            .header(header::CONTENT_TYPE, "application/x-www-form-urlencoded")
            .body(Body::from(form.to_owned()));
        text(self.send(request.unwrap()).await).await
    }

    /// What Ada's forms carry.
    pub async fn form_token(&self) -> String {
        token_in(&self.get("/account", true).await.1)
    }
}

/// The token in the first form of a page.
pub fn token_in(page: &str) -> String {
    let (_, rest) = page.split_once("name=\"form_token\" value=\"").unwrap();
    rest.split('"').next().unwrap().to_owned()
}

pub async fn text(response: Response<Body>) -> (StatusCode, String) {
    let status = response.status();
    let bytes = axum::body::to_bytes(response.into_body(), 64 << 20).await.unwrap();
    (status, String::from_utf8_lossy(&bytes).into_owned())
}

/// Scores of all images of a phase: scenes differ, and images within them.
fn made_up(id: &str, phase: Phase, psnr: f64) -> Scores {
    let random = Random::new(id.bytes().map(u64::from).sum(), 0);
    let splits: &[(Split, usize)] = match phase {
        Phase::Val => &[(Split::Val, 9)],
        Phase::Test => &[(Split::Easy, 111), (Split::Hard, 9)],
    };
    let mut images = Vec::new();
    for (s, scene) in SCENES.iter().enumerate() {
        for &(split, count) in splits {
            for i in 0..count {
                let noise = f64::from(random.uniform_at((1000 * s + i) as u64)) - 0.5;
                let of_scene = (s as f64 * 1.7).sin() * 2.0 - if split == Split::Hard { 0.6 } else { 0.0 };
                let psnr = psnr + of_scene + 3.0 * noise;
                let ssim = (psnr / 42.0).clamp(0.0, 1.0);
                images.push(ImageScore {
                    scene: (*scene).into(),
                    split,
                    camera: 4 + i / 37,
                    light: i % 37,
                    psnr,
                    ssim,
                });
            }
        }
    }
    Scores::of(images)
}
