//! Structural comparison of two compiled schemas.
//!
//! It covers a small part of buf's FILE rules, for machines without buf or the sources. No message, field, enum value
//! or method may be missing or changed.

use prost_reflect::{DescriptorPool, EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor, ServiceDescriptor};

/// Removals and changes in the new schema that break users of the old one.
pub(super) fn breaking_changes(old: &DescriptorPool, new: &DescriptorPool) -> Vec<String> {
    let mut problems = Vec::new();
    for message in old.all_messages() {
        match new.get_message_by_name(message.full_name()) {
            None => problems.push(format!("message {} is gone", message.full_name())),
            Some(now) => fields(&message, &now, &mut problems),
        }
    }
    for values in old.all_enums() {
        match new.get_enum_by_name(values.full_name()) {
            None => problems.push(format!("enum {} is gone", values.full_name())),
            Some(now) => enum_values(&values, &now, &mut problems),
        }
    }
    for service in old.services() {
        match new.services().find(|s| s.full_name() == service.full_name()) {
            None => problems.push(format!("service {} is gone", service.full_name())),
            Some(now) => methods(&service, &now, &mut problems),
        }
    }
    problems
}

fn fields(old: &MessageDescriptor, new: &MessageDescriptor, problems: &mut Vec<String>) {
    for field in old.fields() {
        let name = field.full_name();
        let Some(now) = new.get_field(field.number()) else {
            problems.push(format!("field {name} = {} is gone", field.number()));
            continue;
        };
        let (was, is) = (described(&field), described(&now));
        if was != is {
            problems.push(format!("field {name} = {}: was `{was}`, is `{is}`", field.number()));
        }
    }
}

/// The parts of a field that are visible on the wire or in generated code.
fn described(field: &FieldDescriptor) -> String {
    let kind = match field.kind() {
        Kind::Message(message) => message.full_name().to_owned(),
        Kind::Enum(values) => values.full_name().to_owned(),
        scalar => format!("{scalar:?}").to_lowercase(),
    };
    let oneof = field.containing_oneof().filter(|o| !o.is_synthetic());
    let within = oneof.map_or_else(String::new, |o| format!(" of oneof {}", o.name()));
    let presence = if field.supports_presence() { " with presence" } else { "" };
    format!("{:?} {kind} {}{within}{presence}", field.cardinality(), field.name()).to_lowercase()
}

fn enum_values(old: &EnumDescriptor, new: &EnumDescriptor, problems: &mut Vec<String>) {
    for value in old.values() {
        let now = new.get_value(value.number());
        if now.as_ref().map(|v| v.name().to_owned()).as_deref() != Some(value.name()) {
            let is = now.map_or_else(|| "is gone".to_owned(), |v| format!("is now {}", v.name()));
            problems.push(format!("enum value {} = {} {is}", value.full_name(), value.number()));
        }
    }
}

fn methods(old: &ServiceDescriptor, new: &ServiceDescriptor, problems: &mut Vec<String>) {
    for method in old.methods() {
        let same = new.methods().any(|now| {
            now.name() == method.name()
                && now.input().full_name() == method.input().full_name()
                && now.output().full_name() == method.output().full_name()
                && now.is_client_streaming() == method.is_client_streaming()
                && now.is_server_streaming() == method.is_server_streaming()
        });
        if !same {
            problems.push(format!("method {} is missing or has other messages", method.full_name()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost_reflect::prost_types::field_descriptor_proto::Type;
    use prost_reflect::prost_types::{DescriptorProto, FileDescriptorProto, FileDescriptorSet};
    use sg_proto::prost::Message as _;

    fn compiled() -> FileDescriptorSet {
        FileDescriptorSet::decode(sg_proto::DESCRIPTORS).unwrap()
    }

    fn pool(files: FileDescriptorSet) -> DescriptorPool {
        DescriptorPool::from_file_descriptor_set(files).unwrap()
    }

    fn file<'a>(files: &'a mut FileDescriptorSet, domain: &str) -> &'a mut FileDescriptorProto {
        let package = format!("supergaussian.{domain}.v1");
        files.file.iter_mut().find(|f| f.package() == package).unwrap()
    }

    fn message<'a>(file: &'a mut FileDescriptorProto, name: &str) -> &'a mut DescriptorProto {
        file.message_type.iter_mut().find(|m| m.name() == name).unwrap()
    }

    /// An edit that removes parts of a schema.
    fn broken_by(edit: impl FnOnce(&mut FileDescriptorSet)) -> Vec<String> {
        let mut files = compiled();
        edit(&mut files);
        breaking_changes(&pool(compiled()), &pool(files))
    }

    #[test]
    fn additions_break_nothing() {
        assert_eq!(broken_by(|_| ()), Vec::<String>::new());
        let added = broken_by(|files| {
            let error = message(file(files, "bus"), "Error");
            let mut field = error.field.first().unwrap().clone();
            field.number = Some(77);
            field.name = Some("more".into());
            field.json_name = None;
            error.field.push(field);
        });
        assert_eq!(added, Vec::<String>::new());
    }

    #[test]
    fn breaking_changes_are_found() {
        let gone = broken_by(|files| file(files, "launch").message_type.retain(|m| m.name() != "DownReply"));
        assert_eq!(gone, ["message supergaussian.launch.v1.DownReply is gone"]);

        let retyped = broken_by(|files| {
            let health = message(file(files, "bus"), "Health");
            health.field.iter_mut().find(|f| f.name() == "refused").unwrap().set_type(Type::Uint32);
        });
        assert!(retyped.len() == 1 && retyped[0].contains("Health.refused = 8"), "{retyped:?}");

        let renumbered = broken_by(|files| {
            let health = message(file(files, "bus"), "Health");
            health.field.iter_mut().find(|f| f.name() == "refused").unwrap().number = Some(99);
        });
        assert_eq!(renumbered, ["field supergaussian.bus.v1.Health.refused = 8 is gone"]);

        let renamed = broken_by(|files| {
            let code = file(files, "bus").enum_type.iter_mut().find(|e| e.name() == "Code").unwrap();
            code.value.iter_mut().find(|v| v.number() == 5).unwrap().name = Some("CODE_LOST".into());
        });
        assert_eq!(renamed, ["enum value supergaussian.bus.v1.CODE_NOT_FOUND = 5 is now CODE_LOST"]);

        let method = broken_by(|files| {
            let service = file(files, "backend").service.first_mut().unwrap();
            service.method.first_mut().unwrap().server_streaming = Some(true);
        });
        assert!(method.len() == 1 && method[0].contains("BackendService.Complete"), "{method:?}");
    }
}
