//! JSON messages of OpenAI's chat completions, a protocol that many servers speak.

use serde::Deserialize;
use serde_json::{Map, Value, json};
use sg_language::prompt::{InvalidAnswer, Prompt, single_line};

use crate::error::LlmError;
use crate::model::Completion;

/// Path of the method, relative to the endpoint.
pub(crate) const PATH: &str = "chat/completions";

/// The body of a request.
pub(crate) fn request(prompt: &Prompt, model: &str, temperature: Option<f64>, seed: Option<u64>) -> Value {
    let mut body = Map::new();
    body.insert("model".to_owned(), json!(model));
    let messages = json!([{"role": "system", "content": prompt.system}, {"role": "user", "content": prompt.user}]);
    body.insert("messages".to_owned(), messages);
    body.insert("max_completion_tokens".to_owned(), json!(prompt.max_tokens));
    if let Some(temperature) = temperature {
        body.insert("temperature".to_owned(), json!(temperature));
    }
    if let Some(seed) = seed {
        body.insert("seed".to_owned(), json!(seed));
    }
    if let Some(schema) = &prompt.schema {
        let format = json!({"name": "answer", "strict": true, "schema": schema});
        body.insert("response_format".to_owned(), json!({"type": "json_schema", "json_schema": format}));
    }
    Value::Object(body)
}

#[derive(Deserialize)]
struct Answer {
    #[serde(default)]
    model: String,
    choices: Vec<Choice>,
    usage: Option<Usage>,
}

#[derive(Deserialize)]
struct Choice {
    message: Message,
    finish_reason: Option<String>,
}

#[derive(Deserialize)]
struct Message {
    content: Option<String>,
    refusal: Option<String>,
}

#[derive(Deserialize, Default)]
struct Usage {
    #[serde(default)]
    prompt_tokens: u32,
    #[serde(default)]
    completion_tokens: u32,
}

/// The completion in the body of an answer with status 200.
///
/// # Errors
/// [`LlmError::InvalidAnswer`]: the answer is malformed, empty or cut off. [`LlmError::Refused`]: the model refused.
pub(crate) fn parse_answer(body: &[u8]) -> Result<Completion, LlmError> {
    let invalid = |reason: String| LlmError::InvalidAnswer(InvalidAnswer::new(reason));
    let answer: Answer = serde_json::from_slice(body)
        .map_err(|e| invalid(format!("it is not a chat completion: {}", single_line(&e.to_string()))))?;
    let usage = answer.usage.unwrap_or_default();
    let choice = answer.choices.into_iter().next().ok_or_else(|| invalid("it has no choices".to_owned()))?;
    if let Some(refusal) = choice.message.refusal.filter(|r| !r.is_empty()) {
        return Err(LlmError::Refused(single_line(&refusal)));
    }
    match choice.finish_reason.as_deref() {
        Some("length") => return Err(invalid("it reached the token limit".to_owned())),
        Some("content_filter") => return Err(LlmError::Refused("the provider filtered the answer".to_owned())),
        _ => (),
    }
    let text = choice.message.content.filter(|t| !t.trim().is_empty());
    Ok(Completion {
        text: text.ok_or_else(|| invalid("it is empty".to_owned()))?,
        model: single_line(&answer.model),
        prompt_tokens: usage.prompt_tokens,
        answer_tokens: usage.completion_tokens,
    })
}

/// The text in the body of a chat completion.
///
/// # Errors
/// [`LlmError::InvalidAnswer`]: the answer is malformed, empty or cut off. [`LlmError::Refused`]: the model refused.
pub fn completion_text(body: &[u8]) -> Result<String, LlmError> {
    parse_answer(body).map(|completion| completion.text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prompt() -> Prompt {
        Prompt {
            agent: "agent-intent",
            system: "task".into(),
            user: "{}".into(),
            schema: Some(json!({"type": "object"})),
            max_tokens: 9,
            id: "id".into(),
        }
    }

    #[test]
    fn a_request_holds_only_configured_parameters() {
        let body = request(&prompt(), "m", Some(0.0), Some(7));
        assert_eq!(body["messages"][1], json!({"role": "user", "content": "{}"}));
        assert_eq!(body["response_format"]["json_schema"]["schema"], json!({"type": "object"}));
        assert_eq!(
            (&body["temperature"], &body["seed"], &body["max_completion_tokens"]),
            (&json!(0.0), &json!(7), &json!(9))
        );
        let plain = request(&Prompt { schema: None, ..prompt() }, "m", None, None);
        let keys: Vec<&String> = plain.as_object().unwrap().keys().collect();
        assert_eq!(keys.len(), 3, "{keys:?}");
    }

    #[test]
    fn answers_are_parsed_and_truncated_ones_refused() {
        let body = |finish: &str, content: &str| {
            format!(
                r#"{{"model": "m-1", "choices": [{{"finish_reason": "{finish}", "message": {{"role": "assistant", "content": {content}}}}}],
                    "usage": {{"prompt_tokens": 5, "completion_tokens": 2, "total_tokens": 7}}}}"#
            )
        };
        let expected = Completion { text: "hello".into(), model: "m-1".into(), prompt_tokens: 5, answer_tokens: 2 };
        assert_eq!(parse_answer(body("stop", "\"hello\"").as_bytes()), Ok(expected));
        for bad in
            [&body("length", "\"hel\""), &body("stop", "\"\""), &body("stop", "null"), r#"{"choices": []}"#, "<html>"]
        {
            assert!(matches!(parse_answer(bad.as_bytes()), Err(LlmError::InvalidAnswer(_))), "{bad}");
        }
        let refusal = r#"{"choices": [{"message": {"content": null, "refusal": "I will not"}}]}"#;
        assert_eq!(parse_answer(refusal.as_bytes()), Err(LlmError::Refused("I will not".into())));
    }
}
