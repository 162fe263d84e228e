//! The actor of the views. It has a queue of its own, so that questions for units do not wait for pictures.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use sg_edit::{EditState, PlacedScene, Replica};
use sg_proto::labeling;
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::progress;
use sg_runtime::scene_replica::SceneReplica;

use crate::region_views::{RegionViewsError, ViewsOptions, region_views};

/// A request for views.
pub(crate) struct ViewsMessage {
    pub(crate) request: labeling::ViewsRequest,
    pub(crate) context: Context,
    pub(crate) reply: Reply<labeling::ViewsReply>,
}

/// Finds views of regions, one request at a time.
pub(crate) struct Viewer {
    scene: SceneReplica<Replica>,
    placed: PlacedScene,
    answered: u64,
}

/// Observable state: the number of answers.
#[derive(Clone)]
pub(crate) struct ViewerState(u64);

impl fmt::Display for ViewerState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} requests", self.0)
    }
}

impl Viewer {
    pub(crate) fn new(scene: SceneReplica<Replica>, placed: PlacedScene) -> Self {
        Self { scene, placed, answered: 0 }
    }

    async fn views(&self, request: &labeling::ViewsRequest, context: &Context) -> Result<labeling::ViewsReply, Fault> {
        let options = ViewsOptions::of(request)?;
        let newest = self.scene.at_least(request.at_least_revision, context.deadline).await?;
        let state: Arc<EditState> = Arc::clone(newest.replica.state());
        let (progress, deadline) = (progress::current(), context.deadline);
        let between = || {
            progress.step();
            if Instant::now() < deadline { Ok(()) } else { Err(RegionViewsError::Late) }
        };
        tokio::task::block_in_place(|| {
            let members = if let Some(target) = &request.target {
                let members = state.targeted(target);
                Arc::new(members.map_err(|e| Fault::new(e.code(), e.to_string()).with_details(e.details()))?)
            } else if request.unit.is_empty() {
                let selected = state.selection().mask();
                if selected.is_none() {
                    return Err(Fault::precondition("nothing is selected; select something or name a unit"));
                }
                Arc::clone(selected)
            } else {
                let unit = state.find(&request.unit);
                state.members(unit.map_err(|e| Fault::new(e.code(), e.to_string()).with_details(e.details()))?)
            };
            Ok(region_views(&self.placed.of(&state), &state, &members, options, &between)?)
        })
    }
}

impl Actor for Viewer {
    type Message = ViewsMessage;
    type State = ViewerState;

    fn name(&self) -> &'static str {
        "views"
    }

    fn state(&self) -> ViewerState {
        ViewerState(self.answered)
    }

    async fn handle(&mut self, message: ViewsMessage) -> Result<(), ActorError> {
        let ViewsMessage { request, context, reply } = message;
        // A caller that has gone away loses only the reply.
        let _ = reply.send(self.views(&request, &context).await);
        self.answered += 1;
        Ok(())
    }
}
