//! What a page is told. A page that reads slowly gets the newest state and plan and misses what came in between; one that
//! reads nothing is let go.

use super::message::Message as Told;
use super::{Letter, closing};
use crate::daemon::app::App;
use crate::daemon::drive::active::{Active, Update};
use crate::daemon::drive::closed;
use axum::extract::ws::{Message, WebSocket};
use futures_util::SinkExt;
use futures_util::stream::SplitSink;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::mpsc;

/// What a page wants to be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wants {
    /// The scene, once.
    pub scene: bool,
    /// The state, as it changes.
    pub state: bool,
    /// Plans, as they are driven.
    pub plan: bool,
    /// With the predicted field, some 16 kB each.
    pub field: bool,
}

impl Wants {
    /// Names in a request.
    pub const NAMES: &'static str = "scene, state, plan, field";
    /// What a page gets that does not say: no maps, as most clients draw none.
    pub const DEFAULT: Self = Self { scene: true, state: true, plan: true, field: false };

    /// From names with commas between.
    ///
    /// # Errors
    /// The name that is none.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut wants = Self { scene: false, state: false, plan: false, field: false };
        for name in text.split(',').map(str::trim).filter(|name| !name.is_empty()) {
            match name {
                "scene" => wants.scene = true,
                "state" => wants.state = true,
                "plan" => wants.plan = true,
                // A field belongs to its plan.
                "field" => (wants.plan, wants.field) = (true, true),
                other => return Err(other.into()),
            }
        }
        Ok(wants)
    }

    fn plan_message(self, app: &App, active: &Active) -> Value {
        match self.field {
            // The first page that asks works it out.
            true => tokio::task::block_in_place(|| json!(Told::plan(active, Some(&app.table)))),
            false => json!(Told::plan(active, None)),
        }
    }
}

/// Tells a page until it goes away, the daemon ends, or nobody replies any more.
pub async fn write(
    app: Arc<App>,
    mut sink: SplitSink<WebSocket, Message>,
    mut letters: mpsc::Receiver<Letter>,
    mut replies: mpsc::Receiver<Value>,
    wants: Wants,
) {
    let (mut device, mut updates, mut ending) = (app.driver.device(), app.driver.updates(), app.driver.closing());
    let limit = app.limits.page;
    let mut first = Vec::new();
    first.extend(wants.scene.then(|| Message::Text(app.scene.message.clone())));
    first.extend(wants.state.then(|| text(&state_message(&app))));
    // The plan that the page knows of.
    let mut known = app.driver.active().filter(|_| wants.plan);
    first.extend(known.as_ref().map(|active| text(&wants.plan_message(&app, active))));
    for message in first {
        if !send(&mut sink, message, limit).await {
            return;
        }
    }
    let farewell = loop {
        let message = tokio::select! {
            letter = letters.recv() => match letter {
                Some(Letter::Ping) => Some(Message::Ping(axum::body::Bytes::new())),
                Some(Letter::Close(farewell)) => break Some(farewell),
                // The page has said that it goes; that is said back.
                None => break None,
            },
            Some(reply) = replies.recv() => Some(text(&reply)),
            changed = device.changed(), if wants.state => match changed {
                Ok(()) => Some(text(&state_message(&app))),
                Err(_) => break Some(closing::frame_for_end()),
            },
            update = updates.recv() => match update {
                Ok(Update::Plan(active)) if wants.plan => {
                    known = Some(Arc::clone(&active));
                    Some(text(&wants.plan_message(&app, &active)))
                }
                // It is looked at below.
                Ok(Update::Plan(_) | Update::Ends) => None,
                Ok(Update::Stopped) => wants.state.then(|| text(&state_message(&app))),
                // Some were missed; the newest is what counts.
                Err(RecvError::Lagged(_)) => {
                    updates = updates.resubscribe();
                    let newest = app.driver.active().filter(|_| wants.plan);
                    known = newest.clone().or(known);
                    newest.map(|active| text(&wants.plan_message(&app, &active)))
                }
                Err(RecvError::Closed) => break Some(closing::frame_for_end()),
            },
            () = over(&app, known.as_ref().map_or(0, |known| known.id)), if known.is_some() => {
                known = None;
                Some(text(&json!(Told::no_plan())))
            }
            () = closed(&mut ending) => break Some(closing::frame_for_end()),
        };
        if let Some(message) = message
            && !send(&mut sink, message, limit).await
        {
            return;
        }
    };
    if let Some(farewell) = farewell {
        send(&mut sink, Message::Close(Some(farewell)), limit).await;
    }
    let _ = tokio::time::timeout(limit, sink.close()).await;
}

/// Until the plan that the page knows of is over. A newer one is told before: that is no end.
async fn over(app: &App, id: u64) {
    while let Some(until) = app.driver.end_of(id) {
        tokio::time::sleep_until(until.into()).await;
    }
}

fn state_message(app: &App) -> Value {
    json!(Told::State(Box::new(app.view_state())))
}

fn text(message: &Value) -> Message {
    Message::Text(message.to_string().into())
}

/// Whether it was taken in time.
async fn send(sink: &mut SplitSink<WebSocket, Message>, message: Message, limit: Duration) -> bool {
    match tokio::time::timeout(limit, sink.send(message)).await {
        Ok(Ok(())) => true,
        // The page has closed meanwhile, which is said back.
        Ok(Err(_)) => {
            let _ = tokio::time::timeout(limit, sink.close()).await;
            false
        }
        Err(_) => {
            tracing::info!("a page that reads nothing is let go");
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_says_what_it_wants() {
        let only = |scene, state, plan, field| Ok(Wants { scene, state, plan, field });
        assert_eq!(Wants::parse("state"), only(false, true, false, false));
        assert_eq!(Wants::parse("scene, field"), only(true, false, true, true));
        assert_eq!(Wants::parse("scene,state,plan,field"), only(true, true, true, true));
        assert_eq!(Wants::parse("scene,state,plan"), Ok(Wants::DEFAULT));
        assert_eq!(Wants::parse(""), only(false, false, false, false));
        assert_eq!(Wants::parse("plan,map"), Err("map".into()));
    }
}
