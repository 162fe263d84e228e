//! The labeling process: it answers which units a text means, and how units look.
//!
//! It keeps no state of its own: names and looks are those of the scene. So a restart loses nothing.

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use sg_edit::{EditState, PlacedScene, Replica};
use sg_formats::load_verified::load_verified;
use sg_labeling::attributes::Attributes;
use sg_labeling::attributes::words::describing;
use sg_labeling::meaning::LabelCosines;
use sg_labeling::pictures::UnitPictures;
use sg_labeling::query::QueryContext;
use sg_proto::keys::{self, role};
use sg_proto::labeling;
use sg_runtime::actor::{Actor, ActorError, Mailbox, Reply};
use sg_runtime::bus::RetainedValue;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use sg_runtime::scene_replica::SceneReplica;
use supergaussian_labeling::embedding_cache::EmbeddingCache;
use tokio::sync::watch;

use crate::embedder::{Embedder, EmbeddingProgress};
use crate::label_encoder::LabelEncoder;
use crate::measured_units::{MeasuredUnits, Units, frame_of, labelled};
use crate::params::Params;
use crate::picture_query;
use crate::region_proposals::{RegionProposals, may_be_region};
use crate::unit_embeddings::UnitEmbeddings;
use crate::viewer::{Viewer, ViewsMessage};
use crate::wire;

/// Length of the request queue.
const QUEUE: usize = 8;
/// Length of the queue of services that start and end.
const LIVELINESS_QUEUE: usize = 64;
/// Longest text to find, bytes.
const MAX_TEXT_BYTES: usize = 512;
/// Time without a change of the scene after which units are measured in advance.
const SETTLED: Duration = Duration::from_millis(250);
/// What answers are based on without a sentence encoder.
const BY_WORDS: &str = "labels and looks, without a neural network";
/// What answers are based on with one.
const BY_MEANING: &str = "labels, their meanings by a sentence encoder, and looks";

/// Loads the scene and starts to serve.
///
/// # Errors
/// [`StartError`] for invalid parameters, an unreadable scene or a failure of the bus.
pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::LABELING {
        return Err(StartError::Input(format!("role `{}`: this executable serves `{}`", host.role(), role::LABELING)));
    }
    let params: Params = host.params()?;
    let encoder = tokio::task::block_in_place(|| params.label_encoder());
    let encoder = encoder.map_err(|e| StartError::Input(e.to_string()))?;
    let embeddings = tokio::task::block_in_place(|| params.embeddings());
    let embeddings = embeddings.map_err(|e| StartError::Input(e.to_string()))?;
    let scene = SceneReplica::<Replica>::follow(host.bus()).await?;
    let newest = scene.newest();
    let geometry = newest.replica.state().geometry();
    let path = host.scene_path(&geometry.path, &geometry.hash, &newest.context).await?;
    let file = tokio::task::block_in_place(|| load_verified(&path, &geometry.hash));
    let file = file.map_err(|e| StartError::Input(e.to_string()))?;
    let placed = PlacedScene::new(Arc::new(file));
    let viewer = Viewer::new(scene.clone(), placed.clone());
    let regions = RegionProposals::new(host.bus().clone(), host.blobs().clone(), placed.clone());
    let regions = Arc::new(regions);
    let progress = watch::Sender::new(EmbeddingProgress::default());
    if let Some(embeddings) = &embeddings {
        let cache = params.cache.clone().unwrap_or_else(|| host.run_dir().join("embeddings"));
        let embedder = Embedder {
            scene: scene.clone(),
            placed: placed.clone(),
            embeddings: Arc::clone(embeddings),
            regions: Arc::clone(&regions),
            services: host.bus().watch_liveliness(LIVELINESS_QUEUE).await?,
            cache: EmbeddingCache::new(&cache),
            progress: progress.clone(),
            bus: host.bus().clone(),
        };
        tokio::spawn(embedder.run());
    }
    let units = MeasuredUnits::new(placed);
    let published = Published {
        method: if encoder.is_some() { BY_MEANING } else { BY_WORDS },
        image_encoder: embeddings.as_ref().map_or_else(String::new, |e| e.encoder().name().to_owned()),
        progress: progress.subscribe(),
    };
    let labels = watch::Sender::new(Vec::new());
    if let Some(encoder) = &encoder {
        tokio::spawn(encode_labels(Arc::clone(encoder), labels.subscribe()));
    }
    let mut labeler = Labeler { scene: scene.clone(), units, encoder, embeddings, regions, labels, answered: 0 };
    tokio::task::block_in_place(|| labeler.measured(newest.replica.state()))
        .map_err(|fault| StartError::Failed(fault.message))?;

    let owned = host.bus().retain(&keys::LABELING_STATE, published.state(newest.replica.state())).await?;
    let (mailbox, _) = host.spawn(labeler, QUEUE);
    let (views, _) = host.spawn(viewer, QUEUE);
    tokio::spawn(follow(scene, mailbox.clone(), owned, published));
    host.route(&keys::LABELING_FIND, QUEUE, &mailbox, |request, context, reply| Message::Find {
        request,
        context,
        reply,
    })
    .await?;
    host.route(&keys::LABELING_DESCRIBE, QUEUE, &mailbox, |request, context, reply| Message::Describe {
        request,
        context,
        reply,
    })
    .await?;
    host.route(&keys::LABELING_VIEWS, QUEUE, &views, |request, context, reply| ViewsMessage {
        request,
        context,
        reply,
    })
    .await?;
    Ok(())
}

/// What the state says beside the scene's revision.
struct Published {
    method: &'static str,
    image_encoder: String,
    progress: watch::Receiver<EmbeddingProgress>,
}

impl Published {
    fn state(&self, state: &EditState) -> labeling::State {
        let EmbeddingProgress { embedded, pending, embedded_regions } = self.progress.borrow().clone();
        labeling::State {
            revision: state.revision(),
            units: u32::try_from(labelled(state).count()).unwrap_or(u32::MAX),
            method: self.method.to_owned(),
            image_encoder: self.image_encoder.clone(),
            embedded,
            pending,
            embedded_regions,
        }
    }
}

/// Publishes the newest revision and the progress of embeddings, and measures the units once the scene has settled.
async fn follow(
    mut scene: SceneReplica<Replica>,
    mailbox: Mailbox<Message>,
    owned: RetainedValue<labeling::State>,
    mut published: Published,
) {
    let mut is_measured = true;
    let mut newest = scene.newest();
    loop {
        tokio::select! {
            changed = scene.changed() => {
                let Some(newer) = changed else { return };
                (newest, is_measured) = (newer, false);
            }
            // Without an image encoder nobody makes progress.
            Ok(()) = published.progress.changed() => {}
            () = tokio::time::sleep(SETTLED), if !is_measured => {
                is_measured = true;
                // A full queue holds requests, which measure the units too.
                let _ = mailbox.tell(Message::Measure);
                continue;
            }
        }
        let message = published.state(newest.replica.state());
        if let Err(fault) = owned.set(message, &newest.context.next()).await {
            tracing::warn!(%fault, "the state could not be published");
        }
    }
}

/// Encodes labels before somebody asks, a few at a time. Newer labels supersede the ones that are left.
async fn encode_labels(encoder: Arc<LabelEncoder>, mut labels: watch::Receiver<Vec<String>>) {
    while labels.changed().await.is_ok() {
        loop {
            let next = labels.borrow().clone();
            let encoder = Arc::clone(&encoder);
            match tokio::task::spawn_blocking(move || encoder.encode_next(&next)).await {
                Ok(Ok(true)) => {}
                Ok(Ok(false)) => break,
                // Words alone speak for these labels.
                Ok(Err(error)) => {
                    tracing::warn!(%error, "labels could not be encoded");
                    break;
                }
                Err(_) => return,
            }
        }
    }
}

/// Requests to the labeler.
enum Message {
    /// Finds the units that a text or a picture means.
    Find { request: labeling::FindRequest, context: Context, reply: Reply<labeling::FindReply> },
    /// Describes a unit or the selection.
    Describe { request: labeling::DescribeRequest, context: Context, reply: Reply<labeling::DescribeReply> },
    /// Measures the units of the newest revision before somebody asks.
    Measure,
}

/// The actor of the labels. It handles one request at a time.
struct Labeler {
    scene: SceneReplica<Replica>,
    units: MeasuredUnits,
    encoder: Option<Arc<LabelEncoder>>,
    embeddings: Option<Arc<UnitEmbeddings>>,
    /// Regions that nobody has named.
    regions: Arc<RegionProposals>,
    /// Labels to encode in advance.
    labels: watch::Sender<Vec<String>>,
    answered: u64,
}

/// Observable state of the labeler.
#[derive(Clone)]
struct LabelerState {
    revision: u64,
    answered: u64,
}

impl fmt::Display for LabelerState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "revision {}, {} requests", self.revision, self.answered)
    }
}

impl Actor for Labeler {
    type Message = Message;
    type State = LabelerState;

    fn name(&self) -> &'static str {
        "labeler"
    }

    fn state(&self) -> LabelerState {
        LabelerState { revision: self.scene.newest().replica.state().revision(), answered: self.answered }
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        // A caller that has gone away loses only the reply.
        match message {
            Message::Find { request, context, reply } => {
                let _ = reply.send(self.find(&request, &context).await);
            }
            Message::Describe { request, context, reply } => {
                let _ = reply.send(self.describe(&request, &context).await);
            }
            Message::Measure => {
                let state = Arc::clone(self.scene.newest().replica.state());
                if let Err(fault) = tokio::task::block_in_place(|| self.measured(&state)) {
                    tracing::warn!(%fault, "the units could not be measured");
                }
                return Ok(());
            }
        }
        self.answered += 1;
        Ok(())
    }
}

impl Labeler {
    /// The units of a state, measured.
    fn measured(&mut self, state: &EditState) -> Result<Arc<Units>, Fault> {
        let units = self.units.of(state).map_err(|e| Fault::internal(e.to_string()))?;
        self.labels.send_if_modified(|labels| {
            let is_new = *labels != units.names;
            if is_new {
                labels.clone_from(&units.names);
            }
            is_new
        });
        Ok(units)
    }

    /// The look of the selection. `None` if nothing is selected, or nothing of it is visible.
    fn selection(&self, state: &EditState) -> Option<Attributes> {
        let selected = state.selection().mask();
        if selected.is_none() { None } else { self.units.look_of(state, selected) }
    }

    async fn state_at(&self, revision: u64, context: &Context) -> Result<Arc<EditState>, Fault> {
        let newest = self.scene.at_least(revision, context.deadline).await?;
        Ok(Arc::clone(newest.replica.state()))
    }

    async fn find(&mut self, request: &labeling::FindRequest, context: &Context) -> Result<labeling::FindReply, Fault> {
        if request.text.len() > MAX_TEXT_BYTES {
            let found = request.text.len();
            return Err(Fault::invalid(format!("the text has {found} bytes; the limit is {MAX_TEXT_BYTES}")));
        }
        if !(request.text.is_empty() || request.picture.is_empty()) {
            return Err(Fault::invalid("a text and a picture are given; ask for one of them at a time"));
        }
        let state = self.state_at(request.at_least_revision, context).await?;
        let found: Result<_, Fault> = tokio::task::block_in_place(|| {
            let units = self.measured(&state)?;
            if !request.picture.is_empty() {
                let found = picture_query::find(&request.picture, &units.names, self.embeddings.as_deref())?;
                return Ok((wire::encode(found, &units), false));
            }
            let encoder = self.encoder.as_ref().map(|encoder| encoder.labelled(&units.names));
            let pictures = self.embeddings.as_ref().map(|embeddings| embeddings.of(&units.names));
            let selection = || self.selection(&state);
            let context = QueryContext {
                meaning: encoder.as_ref().map(|encoder| encoder as &dyn LabelCosines),
                pictures: pictures.as_ref().map(|pictures| pictures as &dyn UnitPictures),
                selection: Some(&selection),
            };
            let outcome = units.queryable.find_by(&request.text, context);
            let may_be_region = request.regions && may_be_region(&outcome, self.embeddings.is_some());
            Ok((wire::encode(outcome, &units), may_be_region))
        });
        let (mut reply, may_be_region) = found?;
        if may_be_region && let Some(regions) = self.regions.of(&state, context).await {
            let embeddings = self.embeddings.as_deref();
            let found = tokio::task::block_in_place(|| regions.find(&request.text, frame_of(&state), embeddings));
            reply.regions = found.map_err(|e| Fault::internal(e.to_string()))?;
        }
        Ok(reply)
    }

    async fn describe(
        &mut self,
        request: &labeling::DescribeRequest,
        context: &Context,
    ) -> Result<labeling::DescribeReply, Fault> {
        let state = self.state_at(request.at_least_revision, context).await?;
        tokio::task::block_in_place(|| {
            let units = self.measured(&state)?;
            let known = units.queryable.looks();
            let (looks, at) = if request.unit.is_empty() {
                let selected = state.selection().mask();
                if selected.is_none() {
                    return Err(Fault::precondition("nothing is selected; select something or name a unit"));
                }
                (Cow::Owned(known.with(self.units.look_of(&state, selected))), known.len())
            } else {
                let at = units.names.iter().position(|name| *name == request.unit);
                let at = at.ok_or_else(|| Fault::not_found(format!("no unit is named `{}`", request.unit)))?;
                (Cow::Borrowed(known), at)
            };
            Ok(labeling::DescribeReply {
                words: describing(&looks, at),
                look: looks.of(at).map(|look| wire::encode_look(&request.unit, look)),
                revision: units.revision,
            })
        })
    }
}
