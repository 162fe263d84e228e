//! One input of the table.

/// What stands under a name.
#[derive(Debug, Clone)]
pub(crate) enum Content {
    Bytes(Vec<u8>),
    Pipe,
    Socket,
    Folder,
    Link(String),
    /// A file of this length without a stored byte.
    Holes(u64),
}

/// How the command must end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// Exit status 2 and one line on standard error.
    Refused,
    /// Exit status 2; one line for each of a few mistakes, with indented lines of the file.
    Mistakes,
    /// Exit status 0: the input is large, but right.
    Done,
}

/// A command, the files it meets, and its ending.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    pub(crate) family: &'static str,
    pub(crate) name: String,
    pub(crate) files: Vec<(String, Content)>,
    /// Words after `supergaussian`.
    pub(crate) words: Vec<String>,
    pub(crate) ending: Ending,
}

impl Case {
    pub(crate) fn new(family: &'static str, name: impl Into<String>, words: &[&str]) -> Self {
        let words = words.iter().map(|w| (*w).to_owned()).collect();
        Self { family, name: name.into(), files: Vec::new(), words, ending: Ending::Refused }
    }

    pub(crate) fn with(mut self, name: &str, content: Content) -> Self {
        self.files.push((name.to_owned(), content));
        self
    }

    pub(crate) fn bytes(self, name: &str, bytes: impl Into<Vec<u8>>) -> Self {
        self.with(name, Content::Bytes(bytes.into()))
    }

    pub(crate) fn ending(mut self, ending: Ending) -> Self {
        self.ending = ending;
        self
    }

    pub(crate) fn title(&self) -> String {
        format!("{}/{}", self.family, self.name)
    }
}
