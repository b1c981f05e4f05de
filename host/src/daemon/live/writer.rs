//! What a page is told. A page that reads slowly gets the newest state and plan and misses what came in between; one that
//! reads nothing is let go.

use super::message::LiveMessage;
use super::{WriterCommand, closing};
use crate::daemon::app::App;
use crate::daemon::drive::active::Update;
use crate::daemon::drive::wait_for_closing;
use crate::daemon::touch::active_plan::ActivePlan;
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
pub struct PageTopics {
    /// The scene, once.
    pub scene: bool,
    /// The state, as it changes.
    pub state: bool,
    /// Plans, as they are driven.
    pub plan: bool,
    /// With the predicted field, some 16 kB each.
    pub field: bool,
}

impl PageTopics {
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

    fn build_plan_message(self, app: &App, active: &ActivePlan) -> Value {
        match self.field {
            // The first page that asks works it out.
            true => tokio::task::block_in_place(|| {
                json!(LiveMessage::from_plan_with_field_if_table_given(active, Some(&app.table)))
            }),
            false => json!(LiveMessage::from_plan_with_field_if_table_given(active, None)),
        }
    }
}

/// Tells a page until it goes away, the daemon ends, or nobody replies any more.
pub async fn write_messages_to_page(
    app: Arc<App>,
    mut sink: SplitSink<WebSocket, Message>,
    mut commands: mpsc::Receiver<WriterCommand>,
    mut replies: mpsc::Receiver<Value>,
    topics: PageTopics,
) {
    let (mut device, mut updates, mut ending) =
        (app.driver.subscribe_device_snapshots(), app.driver.subscribe_updates(), app.driver.subscribe_closing());
    let limit = app.limits.page;
    let mut first = Vec::new();
    first.extend(topics.scene.then(|| Message::Text(app.scene.message.clone())));
    first.extend(topics.state.then(|| to_text_message(&build_state_message(&app))));
    // The plan that the page knows of.
    let mut known = app.driver.find_active_plan().filter(|_| topics.plan);
    first.extend(known.as_ref().map(|active| to_text_message(&topics.build_plan_message(&app, active))));
    for message in first {
        if !send_within_time_limit(&mut sink, message, limit).await {
            return;
        }
    }
    let farewell = loop {
        let message = tokio::select! {
            letter = commands.recv() => match letter {
                Some(WriterCommand::Ping) => Some(Message::Ping(axum::body::Bytes::new())),
                Some(WriterCommand::Close(farewell)) => break Some(farewell),
                // The page has said that it goes; that is said back.
                None => break None,
            },
            Some(reply) = replies.recv() => Some(to_text_message(&reply)),
            changed = device.changed(), if topics.state => match changed {
                Ok(()) => Some(to_text_message(&build_state_message(&app))),
                Err(_) => break Some(closing::close_frame_for_shutdown()),
            },
            update = updates.recv() => match update {
                Ok(Update::Plan(active)) if topics.plan => {
                    known = Some(Arc::clone(&active));
                    Some(to_text_message(&topics.build_plan_message(&app, &active)))
                }
                // It is looked at below.
                Ok(Update::Plan(_) | Update::Ends) => None,
                Ok(Update::Stopped) => topics.state.then(|| to_text_message(&build_state_message(&app))),
                // Some were missed; the newest is what counts.
                Err(RecvError::Lagged(_)) => {
                    updates = updates.resubscribe();
                    let newest = app.driver.find_active_plan().filter(|_| topics.plan);
                    known = newest.clone().or(known);
                    newest.map(|active| to_text_message(&topics.build_plan_message(&app, &active)))
                }
                Err(RecvError::Closed) => break Some(closing::close_frame_for_shutdown()),
            },
            () = wait_while_plan_or_newer_runs(&app, known.as_ref().map_or(0, |known| known.id)), if known.is_some() => {
                known = None;
                Some(to_text_message(&json!(LiveMessage::without_plan())))
            }
            () = wait_for_closing(&mut ending) => break Some(closing::close_frame_for_shutdown()),
        };
        if let Some(message) = message
            && !send_within_time_limit(&mut sink, message, limit).await
        {
            return;
        }
    };
    if let Some(farewell) = farewell {
        send_within_time_limit(&mut sink, Message::Close(Some(farewell)), limit).await;
    }
    let _ = tokio::time::timeout(limit, sink.close()).await;
}

/// Until the plan that the page knows of is over. A newer one is told before: that is no end.
async fn wait_while_plan_or_newer_runs(app: &App, id: u64) {
    while let Some((_, until)) = app.driver.find_id_and_end_of_current_plan().filter(|(current, _)| *current >= id) {
        tokio::time::sleep_until(until.into()).await;
    }
}

fn build_state_message(app: &App) -> Value {
    json!(LiveMessage::State(Box::new(app.build_state_view())))
}

fn to_text_message(message: &Value) -> Message {
    Message::Text(message.to_string().into())
}

/// Whether it was taken in time.
async fn send_within_time_limit(sink: &mut SplitSink<WebSocket, Message>, message: Message, limit: Duration) -> bool {
    match tokio::time::timeout(limit, sink.send(message)).await {
        Ok(Ok(())) => true,
        // The page has closed meanwhile, which is said back.
        Ok(Err(_)) => {
            let _ = tokio::time::timeout(limit, sink.close()).await;
            false
        }
        Err(_) => {
            tracing::info!("closing the WebSocket of a page: the page did not read the daemon's messages in time");
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_says_what_it_wants() {
        let only = |scene, state, plan, field| Ok(PageTopics { scene, state, plan, field });
        assert_eq!(PageTopics::parse("state"), only(false, true, false, false));
        assert_eq!(PageTopics::parse("scene, field"), only(true, false, true, true));
        assert_eq!(PageTopics::parse("scene,state,plan,field"), only(true, true, true, true));
        assert_eq!(PageTopics::parse("scene,state,plan"), Ok(PageTopics::DEFAULT));
        assert_eq!(PageTopics::parse(""), only(false, false, false, false));
        assert_eq!(PageTopics::parse("plan,map"), Err("map".into()));
    }
}
