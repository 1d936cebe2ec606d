//! JSON-RPC 2.0 as Elite's EC controllers speak it, port 8055: the result is a string that holds JSON.

use serde_json::{Value, json};

use super::super::arm::ArmStatus;
use super::super::error::ArmError;
use super::super::link::{Link, TimeLimits};

/// The error of a controller that is not in remote mode.
const NOT_REMOTE: i64 = -32693;
/// Real answers stay under 1 KiB.
const LONGEST: usize = 1 << 14;
/// Answers to earlier questions, which came too late, that may stand before ours.
const LATE: usize = 16;

/// A connection to the control port.
#[derive(Debug)]
pub(super) struct JsonRpc {
    link: Link,
    limits: TimeLimits,
    last: u64,
}

impl JsonRpc {
    pub fn connect(address: &str, limits: TimeLimits) -> Result<JsonRpc, ArmError> {
        let link = Link::connect(address, "control port (JSON-RPC)", &limits)?;
        Ok(JsonRpc { link, limits, last: 0 })
    }

    /// Calls `method` and returns its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Result<Value, ArmError> {
        self.last += 1;
        let request = json!({"method": method, "params": parameters, "jsonrpc": "2.0", "id": self.last});
        self.link.send(format!("{request}\n").as_bytes())?;
        for _ in 0..LATE {
            let message = self.link.take("answer", self.limits.reply, message_length)?;
            let answer =
                parse(&message).ok_or_else(|| self.link.fault("an answer that is no JSON-RPC".to_owned()))?;
            if answer.id < self.last {
                continue;
            }
            if answer.id > self.last {
                return Err(self.link.fault("an answer to a question that was not asked".to_owned()));
            }
            return answer.outcome.map_err(|refusal| self.refused(method, refusal));
        }
        Err(self.link.fault("nothing but answers to earlier questions".to_owned()))
    }

    fn refused(&self, method: &str, refusal: Refusal) -> ArmError {
        let address = self.link.address().to_owned();
        if refusal.code == NOT_REMOTE {
            return ArmError::Stopped { address, status: ArmStatus::NotInRemote };
        }
        let answer = format!("{} (code {})", refusal.message, refusal.code);
        ArmError::Refused { address, request: method.to_owned(), answer }
    }
}

/// An answer to question `id`.
struct Answer {
    id: u64,
    outcome: Result<Value, Refusal>,
}

struct Refusal {
    code: i64,
    message: String,
}

/// The length of the JSON text at the start of `bytes`, `None` if more must come. Its end is its own: some firmware leaves
/// the newline out.
fn message_length(bytes: &[u8]) -> Result<Option<usize>, String> {
    let mut texts = serde_json::Deserializer::from_slice(bytes).into_iter::<Value>();
    match texts.next() {
        Some(Ok(_)) => Ok(Some(texts.byte_offset())),
        Some(Err(e)) if !e.is_eof() => Err("an answer that is no JSON".to_owned()),
        _ if bytes.len() > LONGEST => Err(format!("an answer of more than {LONGEST} bytes")),
        _ => Ok(None),
    }
}

fn parse(message: &[u8]) -> Option<Answer> {
    let message: Value = serde_json::from_slice(message).ok()?;
    let id = message.get("id")?.as_u64()?;
    if let Some(error) = message.get("error") {
        let code = error.get("code").and_then(Value::as_i64).unwrap_or_default();
        let message = error.get("message").and_then(Value::as_str).unwrap_or("no reason given");
        return Some(Answer {
            id,
            outcome: Err(Refusal { code, message: message.chars().take(200).collect() }),
        });
    }
    let result = serde_json::from_str(message.get("result")?.as_str()?).ok()?;
    Some(Answer { id, outcome: Ok(result) })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn an_answer_ends_where_its_json_ends() {
        let answer = br#"{"jsonrpc":"2.0","result":"[1, 2.5]","id":3}"#;
        assert_eq!(message_length(answer), Ok(Some(answer.len())));
        for end in 0..answer.len() {
            assert_eq!(message_length(&answer[..end]), Ok(None), "{end}");
        }
        let two = [answer.as_slice(), b"\n", answer].concat();
        assert_eq!(message_length(&two), Ok(Some(answer.len())));
        let Answer { id, outcome } = parse(answer).unwrap();
        assert!(id == 3 && outcome.is_ok_and(|result| result == json!([1, 2.5])));
    }

    #[test]
    fn what_is_no_answer_is_refused() {
        for bad in [
            "true",
            "{}",
            r#"{"id":1}"#,
            r#"{"id":1,"result":5}"#,
            r#"{"id":1,"result":"[1"}"#,
            r#"{"result":"1"}"#,
        ] {
            assert!(parse(bad.as_bytes()).is_none(), "{bad}");
        }
        assert!(message_length(b"hello").is_err());
        assert!(message_length(&[0xFF; 10]).is_err());
        assert!(message_length(&vec![b'['; LONGEST + 1]).is_err(), "endless nesting");
        assert!(
            message_length(&[b"\"".as_slice(), &vec![b'a'; LONGEST + 1]].concat()).is_err(),
            "an endless string"
        );
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..60), text in "[{}\":,0-9a-z\\[\\]]{0,60}") {
            for bytes in [bytes.as_slice(), text.as_bytes()] {
                parse(bytes);
                if let Ok(Some(length)) = message_length(bytes) {
                    prop_assert!(length <= bytes.len());
                }
            }
        }
    }
}
