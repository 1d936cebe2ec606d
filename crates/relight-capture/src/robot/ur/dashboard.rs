//! The dashboard server: a line asked, a line answered (UR, "Dashboard Server e-Series").

use super::super::error::ArmError;
use super::super::link::{Link, TimeLimits};

/// A connection to the dashboard server.
#[derive(Debug)]
pub(super) struct Dashboard {
    address: String,
    limits: TimeLimits,
    /// `None` after a failure: answers carry no number, so that a late one would be taken for that to the next question.
    link: Option<Link>,
}

impl Dashboard {
    pub fn connect(address: &str, limits: TimeLimits) -> Result<Dashboard, ArmError> {
        let mut dashboard = Dashboard { address: address.to_owned(), limits, link: None };
        dashboard.link = Some(dashboard.open()?);
        Ok(dashboard)
    }

    fn open(&self) -> Result<Link, ArmError> {
        let mut link = Link::connect(&self.address, "dashboard server", &self.limits)?;
        let greeting = link.take_line("greeting", self.limits.reply)?;
        if !greeting.starts_with("Connected: Universal Robots Dashboard Server") {
            return Err(link.fault(format!("greets with {:?}", shortened(&greeting))));
        }
        Ok(link)
    }

    fn ask(&mut self, question: &str) -> Result<String, ArmError> {
        let mut link = match self.link.take() {
            Some(link) => link,
            None => self.open()?,
        };
        link.send(format!("{question}\n").as_bytes())?;
        let answer = link.take_line("answer", self.limits.reply)?;
        self.link = Some(link);
        Ok(answer)
    }

    /// Whether the arm takes orders over the network.
    pub fn is_remote(&mut self) -> Result<bool, ArmError> {
        let question = "is in remote control";
        match self.ask(question)?.as_str() {
            "true" => Ok(true),
            "false" => Ok(false),
            answer => Err(self.refusal(
                question,
                answer,
                "remote control needs an e-Series arm with PolyScope 5.6 or later",
            )),
        }
    }

    /// Stops the program that runs.
    pub fn stop(&mut self) -> Result<(), ArmError> {
        let answer = self.ask("stop")?;
        if answer == "Stopped" {
            Ok(())
        } else {
            Err(self.refusal("stop", &answer, "stop it on the pendant"))
        }
    }

    fn refusal(&self, request: &str, answer: &str, mend: &str) -> ArmError {
        let answer = format!("{:?}; {mend}", shortened(answer));
        ArmError::Refused { address: self.address.clone(), request: format!("{request:?}"), answer }
    }
}

/// Enough of a peer's words to recognise them.
fn shortened(words: &str) -> String {
    words.chars().take(80).collect()
}
